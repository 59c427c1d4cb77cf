# SPDX-License-Identifier: Apache-2.0
"""Write the pages of the Python interface: the names that packages export, with their docstrings."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from studies.documents.site.links import assigned_names
from studies.tools.provenance import ROOT

PACKAGE = 'cfd_pneumatic'
FOLDER = 'api'
"""Folder of the pages in the site."""


class Export(NamedTuple):
    """
    A name that a package exports.

    Attributes
    ----------
    name
        Name in the package.
    module
        Full name of the module that defines the name.
    original
        Name in the module.

    """

    name: str
    module: str
    original: str

    @property
    def path(self) -> Path:
        """File of the module."""
        path = ROOT.joinpath(*self.module.split('.'))
        return path / '__init__.py' if path.is_dir() else path.with_suffix('.py')


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding='utf-8'))


@cache
def _imports(path: Path) -> dict[str, tuple[str, str]]:
    """Return the names that a module imports from the library, each with its module and its name there."""
    return {
        alias.asname or alias.name: (str(node.module), alias.name)
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(f'{PACKAGE}.')
        for alias in node.names
    }


def packages() -> list[str]:
    """Return the full names of the package and its subpackages that export names."""
    inner = sorted(path.parent.name for path in (ROOT / PACKAGE).glob('*/__init__.py'))
    return [package for package in [PACKAGE, *(f'{PACKAGE}.{name}' for name in inner)] if exports(package)]


def exports(package: str) -> list[Export]:
    """Return the names that a package imports from its modules, in alphabetical order."""
    imports = _imports(ROOT.joinpath(*package.split('.'), '__init__.py'))
    found = [
        Export(name, module, original)
        for name, (module, original) in imports.items()
        if name != 'loader_of' and (package == PACKAGE or module.startswith(f'{package}.'))
    ]
    return sorted(found, key=lambda export: (export.name.lower(), export))


def defining(export: Export) -> Export:
    """Return the export with the module and name of the definition, through all modules that import the name."""
    origin = _imports(export.path).get(export.original)
    return export if origin is None else defining(Export(export.name, *origin))


@cache
def constant_docs(path: Path) -> dict[str, str]:
    """Return the text below each assignment at the top of a module, by name; an empty text without."""
    body = _tree(path).body
    found: dict[str, str] = {}
    for node, after in zip(body, [*body[1:], ast.Pass()]):
        is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        text = after.value.value if is_text else ''  # type: ignore[attr-defined]
        found.update((name, inspect.cleandoc(str(text))) for name in assigned_names(node))
    return found


def write_pages(folder: Path) -> list[str]:
    """
    Write a page for each package into a folder; return the names of the pages in order.

    A package has no page if other pages describe all its names, or if an extra is missing; one line names the missing
    module.
    """
    folder.mkdir(parents=True)
    described: dict[tuple[str, str], str] = {}
    names = []
    for package in packages():
        try:
            text, more = page(package, described)
        except ModuleNotFoundError as error:
            print(f'{package} has no page: the module {error.name} is not installed.', file=sys.stderr)
            continue
        if more:
            described |= more
            names.append(package)
            (folder / f'{package}.rst').write_text(text, encoding='utf-8')
    return names


def page(
    package: str, described: Mapping[tuple[str, str], str] = MappingProxyType({})
) -> tuple[str, dict[tuple[str, str], str]]:
    """
    Return the page of a package in reStructuredText, and the names that the page describes.

    Parameters
    ----------
    package
        Full name.
    described
        For each definition that another page describes, by module and name: its full name there. The result has the
        same form.

    """
    module = import_module(package)
    entries, more, elsewhere = [], {}, []
    for export in exports(package):
        origin = defining(export)
        key = origin.module, origin.original
        if key in described:
            elsewhere.append(described[key])
        else:
            more[key] = f'{package}.{export.name}'
            entries += [*_entry(export, origin, getattr(module, export.name)), '']
    parts = [package, '=' * len(package), '', inspect.cleandoc(module.__doc__ or ''), '']
    if elsewhere:
        links = ', '.join(f':py:obj:`{name.removeprefix(PACKAGE + ".")} <{name}>`' for name in elsewhere)
        parts += [f'The package also exports names that other pages describe: {links}.', '']
    return '\n'.join([*parts, f'.. currentmodule:: {package}', '', *entries]) + '\n', more


def _entry(export: Export, origin: Export, value: Any) -> Iterator[str]:
    """Yield the lines that describe a name."""
    if inspect.isclass(value):
        yield f'.. autoclass:: {export.name}'
        yield '   :members:'
    elif callable(value) and origin.original not in constant_docs(origin.path):
        yield f'.. autofunction:: {export.name}'
    else:
        yield f'.. py:data:: {export.name}'
        yield ''
        for line in constant_docs(origin.path).get(origin.original, '').splitlines():
            yield f'   {line}'.rstrip()
