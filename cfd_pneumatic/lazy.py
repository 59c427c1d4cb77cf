# SPDX-License-Identifier: Apache-2.0
"""Properties that are computed, and names of packages that are loaded, when they are first asked for."""

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


def loader_of(package: str) -> Callable[[str], Any]:
    """
    Return the `__getattr__` of a package that loads a name when it is first asked for.

    The package's source imports its names for type checkers, below `if TYPE_CHECKING:`. These imports are the table of
    names and modules, and what `__all__` names; programs start before all modules are needed.

    Parameters
    ----------
    package
        Full name of the package.

    Raises
    ------
    AttributeError
        By the returned function, if the package does not export a name.

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
