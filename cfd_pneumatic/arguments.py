# SPDX-License-Identifier: Apache-2.0
"""Check the arguments that users pass in Python: a wrong type is an `InputError` with one clear line."""

from __future__ import annotations

import os
from numbers import Real

import numpy as np

from cfd_pneumatic.errors import InputError


def check_type(name: str, value: object, types: type | tuple[type, ...], wanted: str) -> None:
    """
    Refuse an argument that has none of some types.

    Parameters
    ----------
    name
        Name of the argument.
    value
        What the user passed.
    types
        Types that are accepted.
    wanted
        The types for people, with an article: `a recording`.

    Raises
    ------
    InputError
        If the type differs.

    """
    if not isinstance(value, types):
        raise InputError(f'{name} must be {wanted}, not {"None" if value is None else type(value).__name__}')


def check_number(name: str, value: object) -> None:
    """Refuse an argument that is no number; its range is checked elsewhere."""
    if isinstance(value, bool):
        raise InputError(f'{name} must be a number, not {value}')
    check_type(name, value, Real, 'a number')


def check_numbers(*, optional: bool = False, **values: object) -> None:
    """Refuse arguments that are no numbers, or None if they are optional."""
    for name, value in values.items():
        if not (optional and value is None):
            check_number(name, value)


def check_switches(**values: object) -> None:
    """Refuse arguments that are neither true nor false: any text would count as true."""
    for name, value in values.items():
        check_type(name, value, (bool, np.bool_), 'True or False')


def check_path(name: str, value: object) -> None:
    """Refuse an argument that is no path."""
    check_type(name, value, (str, os.PathLike), 'a path')
