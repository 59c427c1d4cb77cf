# SPDX-License-Identifier: Apache-2.0
"""How the model's numerical functions are compiled."""

from __future__ import annotations

from typing import Any

from numba.extending import register_jitable

from cfd_pneumatic.runtime import compiler

kernel = compiler(error_model='numpy', nogil=True)
"""
Compile to machine code kept on disk, beside which other threads run.

A division by zero gives inf, as NumPy's does, instead of a branch to raise.
"""

fused = compiler(error_model='numpy', nogil=True, fastmath={'contract'})
"""As `kernel`, with products and sums rounded once where the processor can; no other liberty is taken."""

inner = compiler(error_model='numpy', nogil=True, fastmath={'contract'}, no_cpython_wrapper=True)
"""As `fused`, for what compiled functions alone call: a way from Python takes as long to compile as the function."""

summed = compiler(error_model='numpy', nogil=True, fastmath={'contract', 'reassoc'})
"""As `fused`, with sums taken in any order: for those of many numbers."""

inlined: Any = register_jitable(
    error_model='numpy',
    nogil=True,
    fastmath={'contract'},
    forceinline=True,
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
)
"""
Compile into what calls it, for the innermost loop; what calls it from Python gets the function as it is.

What stays the same from step to step is read once then, and what two parts compute alike is computed once.
"""
