"""The fit of a model to recordings, and what it tells of its parameters."""
