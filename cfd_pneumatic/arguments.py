# SPDX-License-Identifier: Apache-2.0
"""Checks of arguments of the Python interface; a wrong type is an `InputError` with a clear line."""

from __future__ import annotations

import os
from numbers import Real

import numpy as np

from cfd_pneumatic.errors import InputError


def check_type(name: str, value: object, types: type | tuple[type, ...], wanted: str) -> None:
    """
    Refuse an argument of a wrong type.

    Parameters
    ----------
    name
        Name of the argument.
    value
        Value that the user passed.
    types
        Accepted types.
    wanted
        Accepted types in the message, with an article: `a recording`.

    Raises
    ------
    InputError
        If the type is wrong.

    """
    if not isinstance(value, types):
        raise InputError(f'{name} must be {wanted}, not {"None" if value is None else type(value).__name__}')


def check_number(name: str, value: object) -> None:
    """Refuse an argument that is not a number; its range is checked elsewhere."""
    if isinstance(value, bool):
        raise InputError(f'{name} must be a number, not {value}')
    check_type(name, value, Real, 'a number')


def check_numbers(*, optional: bool = False, **values: object) -> None:
    """Refuse arguments that are not numbers; None is accepted if they are optional."""
    for name, value in values.items():
        if not (optional and value is None):
            check_number(name, value)


def check_switches(**values: object) -> None:
    """Refuse arguments that are not True or False, because any text would count as true."""
    for name, value in values.items():
        check_type(name, value, (bool, np.bool_), 'True or False')


def check_path(name: str, value: object) -> None:
    """Refuse an argument that is not a path."""
    check_type(name, value, (str, os.PathLike), 'a path')
