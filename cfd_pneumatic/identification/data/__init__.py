"""What was measured, made ready: stamps, the smoothed motion, train, validation and test."""
