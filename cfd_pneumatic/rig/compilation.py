# SPDX-License-Identifier: Apache-2.0
"""Numba's compiler, with the types kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba.extending import register_jitable

from cfd_pneumatic.runtime import compiler

Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function on its first call and keep the machine code beside its module."""
    return cast(Function, compiler()(function))


def inner(function: Function) -> Function:
    """Let compiled functions call a function; what calls it from Python gets it as it is."""
    return register_jitable(no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
