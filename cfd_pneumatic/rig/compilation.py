# SPDX-License-Identifier: Apache-2.0
"""Numba's compiler, with type hints preserved."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba.extending import register_jitable

from cfd_pneumatic.runtime import compiler

Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function on its first call and cache the machine code next to its module."""
    return cast(Function, compiler()(function))


def inner(function: Function) -> Function:
    """Let compiled functions call a function; Python calls the plain function."""
    return register_jitable(no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
