# SPDX-License-Identifier: Apache-2.0
"""Every file, and every name in a file, that a document refers to is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
FOLDERS = ('cfd_pneumatic', 'docs', 'launch', 'scripts', 'studies', 'test')
LINK = re.compile(r'\[([^\]]*)\]\(([^)\s]+)\)')
IN_CODE = re.compile(r'```.*?```', re.DOTALL)
FILE = re.compile(r'`([\w./*-]+\.(?:py|md|sh|jinja|yaml|launch\.py))`')
WRITTEN = {'bent_sensor.py', 'parameters.yaml', 'mains_hum.py'}
"""Files that programs write, and the one that docs/how_to/add_an_effect.md adds."""


def text_of(document):
    return IN_CODE.sub('', document.read_text(encoding='utf-8'))


def names_in(path):
    """Return what a module defines at its top, and its classes' methods and attributes behind a dot."""
    found = set()

    def collect(body, prefix):
        for node in body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                found.add(prefix + node.name)
            if isinstance(node, ast.ClassDef):
                collect(node.body, f'{node.name}.')
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, 'target', None)]
            found.update(prefix + one.id for one in targets if isinstance(one, ast.Name))

    collect(ast.parse(path.read_text(encoding='utf-8')).body, '')
    return found


def headings(document):
    """Return the anchors of a document's headings, as GitHub makes them."""
    lines = re.findall(r'^#+ (.*)$', text_of(document), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', line).strip().lower().replace(' ', '-') for line in lines}


def missing(document):
    """Yield what a document refers to and is not there."""
    for label, target in LINK.findall(text_of(document)):
        if '://' in target:
            continue
        file, _, anchor = target.partition('#')
        path = (document.parent / file).resolve() if file else document
        if not path.exists():
            yield target
            continue
        if anchor and anchor not in headings(path):
            yield target
        if path.suffix == '.py':
            named = re.findall(r'`([^`]+)`', label)
            if len(named) == 2 and named[1] not in names_in(path):
                yield f'{named[1]} in {target}'
            if named and named[0].endswith('.py') and named[0].split('/')[-1] != path.name:
                yield f'{target}, called {named[0]}'


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda path: f'{path.parent.name}/{path.stem}')
def test_links_lead_to_files_names_and_headings(document):
    assert list(missing(document)) == []


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda path: f'{path.parent.name}/{path.stem}')
def test_files_that_are_named_are_there(document):
    """By their path from the root, from the package, or by their name alone."""
    named = {name for name in FILE.findall(text_of(document)) if Path(name).name not in WRITTEN}
    lost = {
        name
        for name in named
        if not any((ROOT / folder / name).exists() for folder in ('', 'cfd_pneumatic', 'docs', 'test'))
        and not any(next((ROOT / folder).rglob(name), None) for folder in FOLDERS)
    }
    assert lost == set()


def test_every_picture_is_shown_by_a_page():
    shown = {
        (document.parent / target).resolve()
        for document in DOCUMENTS
        for _, target in LINK.findall(text_of(document))
        if target.endswith(('.png', '.svg'))
    }
    pictures = {path for suffix in ('png', 'svg') for path in (ROOT / 'docs').rglob(f'*.{suffix}')}
    assert pictures - shown == set()


def test_a_reference_to_nothing_is_found(tmp_path):
    (tmp_path / 'module.py').write_text('class Known:\n    field: int = 0\n')
    page = tmp_path / 'page.md'
    page.write_text(
        '# Here\n[a](gone.py) [`module.py`: `Known.field`](module.py) [`module.py`: `unknown`](module.py) '
        '[b](#here) [c](#there) [`other.py`](module.py)\n'
    )
    assert list(missing(page)) == ['gone.py', 'unknown in module.py', '#there', 'module.py, called other.py']
