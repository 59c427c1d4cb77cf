# SPDX-License-Identifier: Apache-2.0
"""Properties that are computed when they are first asked for, and kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

Value = TypeVar('Value')


class lazy_property(Generic[Value]):  # noqa: N801  # read as a decorator
    """
    A property that is computed once.

    As `functools.cached_property` is from Python 3.12 on. Before, all instances of a class share its lock: threads that
    compute it for one instance wait for one that computes it for another. Here two threads that ask one instance at
    once may both compute it.
    """

    def __init__(self, compute: Callable[[Any], Value]) -> None:
        self._compute = compute
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember what it is called."""
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> lazy_property[Value]: ...

    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...

    def __get__(self, instance: object | None, owner: type) -> lazy_property[Value] | Value:
        """Return the value, which the instance has from now on."""
        if instance is None:
            return self
        value = vars(instance)[self._name] = self._compute(instance)
        return value
