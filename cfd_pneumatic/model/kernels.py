# SPDX-License-Identifier: Apache-2.0
"""How the model's numerical functions are compiled."""

from __future__ import annotations

from typing import Any

from numba.extending import register_jitable

from cfd_pneumatic.runtime import compiler

kernel = compiler(error_model='numpy', nogil=True)
"""
Compile to machine code that is kept on disk; other threads run meanwhile.

A division by zero gives inf, as in NumPy, because a check would cost a branch.
"""

fused = compiler(error_model='numpy', nogil=True, fastmath={'contract'})
"""As `kernel`, but a product and a sum are rounded once if the processor can."""

inner = compiler(error_model='numpy', nogil=True, fastmath={'contract'}, no_cpython_wrapper=True)
"""As `fused`, for functions called by compiled code only: a Python wrapper takes as long to compile as a function."""

summed = compiler(error_model='numpy', nogil=True, fastmath={'contract', 'reassoc'})
"""As `fused`, for sums of many numbers: the summands are added in any order."""

inlined: Any = register_jitable(
    error_model='numpy',
    nogil=True,
    fastmath={'contract'},
    forceinline=True,
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
)
"""
Compile a function into each compiled caller, for the innermost loop; Python calls the plain function.

Inlining lets the compiler read constants once and compute common subexpressions once.
"""
