# SPDX-License-Identifier: Apache-2.0
"""Adapt the links and equations of a page for the site."""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from studies.tools.provenance import ROOT

SCHEME = 'source'
"""Scheme of links to source pages: `source:path/of/file.py#line-12`; the Sphinx extension resolves the links."""

_FENCED = re.compile(r'^(?P<indent> *)(?P<fence>`{3,}|~{3,}).*?^ *(?P=fence)`* *$', re.MULTILINE | re.DOTALL)
_LINK = re.compile(r'(?P<image>!?)\[(?P<label>[^\[\]]*)\]\((?P<target>[^)\s]+)\)')
_CODE = re.compile(r'`([^`]+)`')
_EQUATIONS = re.compile(r'^```math\n(?P<latex>.*?)^```$', re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r'\\q?quad\s*\((?P<number>\d+)\)')


def outside_of_fences(text: str, change: Callable[[str], str]) -> str:
    """Return a text of Markdown with a change to all parts outside of fenced blocks."""
    parts, end = [], 0
    for block in _FENCED.finditer(text):
        parts += [change(text[end : block.start()]), block[0]]
        end = block.end()
    return ''.join([*parts, change(text[end:])])


def with_site_links(text: str, page: Path, places: Mapping[Path, str], root: Path = ROOT) -> str:
    """
    Return a page's text with links that are valid in the site.

    Parameters
    ----------
    text
        Markdown.
    page
        File of the page.
    places
        For each file of the repository that is in the site: path from the site's root.
    root
        Folder of the repository.

    Returns
    -------
    str
        Links to other files of the repository have the scheme `source:`. A link to a folder is its label only.

    Raises
    ------
    FileNotFoundError
        If a link leads to a file that does not exist.

    """

    def changed(link: re.Match[str]) -> str:
        target, label = link['target'], link['label']
        if '://' in target or target.startswith(('#', 'mailto:')):
            return link[0]
        file, _, anchor = target.partition('#')
        path = (page.parent / file).resolve()
        if path in places:
            relative = os.path.relpath(places[path], Path(places[page]).parent)
            return f'{link["image"]}[{label}]({relative}{"#" * bool(anchor)}{anchor})'
        if path.is_dir():
            return label
        if not path.is_file():
            raise FileNotFoundError(f'{page}: the link to {target} leads nowhere. Correct the link.')
        return f'[{label}]({source_link(path, definition_in(label), root)})'

    return outside_of_fences(text, lambda part: _LINK.sub(changed, part))


def definition_in(label: str) -> str:
    """Return the name of a definition in a label such as `[file.py: name]`, each of both as code; empty without."""
    codes = _CODE.findall(label)
    return codes[1] if len(codes) == 2 else ''


def source_link(path: Path, name: str = '', root: Path = ROOT) -> str:
    """Return the link to a file of the repository, at the definition of a name if the file has the definition."""
    line = definition_lines(path).get(name) if path.suffix == '.py' else None
    return f'{SCHEME}:{path.relative_to(root)}' + (f'#line-{line}' if line else '')


@cache
def definition_lines(path: Path) -> dict[str, int]:
    """Return the line of each definition at the top of a module and of its classes, by qualified name."""
    found: dict[str, int] = {}

    def collect(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                found[prefix + node.name] = node.lineno
            if isinstance(node, ast.ClassDef):
                collect(node.body, f'{prefix}{node.name}.')
            for name in assigned_names(node):
                found.setdefault(prefix + name, node.lineno)

    collect(ast.parse(path.read_text(encoding='utf-8')).body, '')
    return found


def assigned_names(node: ast.stmt) -> list[str]:
    """Return the plain names that a statement assigns."""
    if isinstance(node, ast.AnnAssign):
        targets: list[ast.expr] = [node.target]
    elif isinstance(node, ast.Assign):
        targets = [part for target in node.targets for part in getattr(target, 'elts', [target])]
    else:
        targets = []
    return [target.id for target in targets if isinstance(target, ast.Name)]


def equation_numbers(text: str) -> list[int]:
    """Return the numbers of the equations of a page, each once, in order."""
    blocks = (block['latex'] for block in _EQUATIONS.finditer(text))
    return list(dict.fromkeys(int(found['number']) for block in blocks for found in _NUMBER.finditer(block)))


def with_equation_targets(text: str) -> str:
    """Return a page's text with a target `equation-N` at the block of each numbered equation."""
    known: set[int] = set()

    def changed(block: re.Match[str]) -> str:
        numbers = [number for number in equation_numbers(block[0]) if number not in known]
        known.update(numbers)
        return ''.join(f'(equation-{number})=\n' for number in numbers) + block[0]

    return _EQUATIONS.sub(changed, text)


def with_equation_references(text: str, numbers: list[int]) -> str:
    """Return a docstring with references to the equations that it names, in reStructuredText."""

    def referenced(phrase: re.Match[str]) -> str:
        return re.sub(
            r'\((\d+)\)',
            lambda found: f':ref:`({found[1]}) <equation-{found[1]}>`' if int(found[1]) in numbers else found[0],
            phrase[0],
        )

    return re.sub(r'[Ee]quations? \(\d+\)(?:(?:,| and| to| or)\s+\(\d+\))*', referenced, text)
