# SPDX-License-Identifier: Apache-2.0
"""What was measured, made ready: stamps, the smoothed motion, train, validation and test."""
