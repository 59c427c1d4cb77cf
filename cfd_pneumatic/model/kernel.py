"""How the model's numerical functions are compiled."""

from __future__ import annotations

from typing import Any

from numba import njit

from cfd_pneumatic.compiling import compiler

kernel = compiler(error_model='numpy', nogil=True)
"""
Compile to machine code kept on disk, beside which other threads run.

A division by zero gives inf, as NumPy's does, instead of a branch to raise.
"""

fused = compiler(error_model='numpy', nogil=True, fastmath={'contract'})
"""As `kernel`, with products and sums rounded once where the processor can; no other liberty is taken."""

summed = compiler(error_model='numpy', nogil=True, fastmath={'contract', 'reassoc'})
"""As `fused`, with sums taken in any order: for those of many numbers."""

_INLINED: dict[str, Any] = {'forceinline': True, 'no_cpython_wrapper': True, 'no_cfunc_wrapper': True}

inlined = njit(error_model='numpy', nogil=True, fastmath={'contract'}, **_INLINED)
"""
Compile into what calls it: for the innermost loop.

What stays the same from step to step is read once then, and what two parts compute alike is computed once.
"""
