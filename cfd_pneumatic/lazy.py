# SPDX-License-Identifier: Apache-2.0
"""Properties that are computed on first access, and packages that load their names on first access."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

Value = TypeVar('Value')


class lazy_property(Generic[Value]):  # noqa: N801  # read as a decorator
    """
    A property that is computed once.

    The behaviour is that of `functools.cached_property` from Python 3.12 on. In older versions all instances share a
    lock, so that threads wait for each other. Without the lock two threads may both compute the property of an
    instance.
    """

    def __init__(self, compute: Callable[[Any], Value]) -> None:
        self._compute = compute
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        """Store the name of the property."""
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> lazy_property[Value]: ...

    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...

    def __get__(self, instance: object | None, owner: type) -> lazy_property[Value] | Value:
        """Compute the value, store it in the instance and return it."""
        if instance is None:
            return self
        value = vars(instance)[self._name] = self._compute(instance)
        return value


def loader_of(package: str) -> Callable[[str], Any]:
    """
    Return a `__getattr__` with which a package loads a name on first access.

    The package's source imports its names for type checkers, below `if TYPE_CHECKING:`. These imports are the table of
    names and modules, and `__all__`. Programs start faster, because modules are loaded when needed.

    Parameters
    ----------
    package
        Full name of the package.

    Raises
    ------
    AttributeError
        Raised by the returned function, if the package does not export a name.

    """
    sources: dict[str, tuple[str, str]] = {}

    def load(name: str) -> Any:
        if not sources:
            sources.update(_imports_for_type_checkers(sys.modules[package].__file__))
        if name == '__all__':
            return list(sources)
        if name not in sources:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        module, original = sources[name]
        value = getattr(import_module(module), original)
        setattr(sys.modules[package], name, value)
        return value

    return load


def _imports_for_type_checkers(file: str | None) -> dict[str, tuple[str, str]]:
    """Return the names that a file imports below `if TYPE_CHECKING:`, each with its module and its name there."""
    tree = ast.parse(Path(str(file)).read_text(encoding='utf-8'))
    blocks = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING']
    return {
        alias.asname or alias.name: (str(line.module), alias.name)
        for block in blocks
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
