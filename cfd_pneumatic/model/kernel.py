"""How the model's numerical functions are compiled."""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, error_model='numpy')
"""Compile to machine code kept on disk; a division by zero gives inf, as NumPy's does, instead of a branch to raise."""
