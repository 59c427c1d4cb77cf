# SPDX-License-Identifier: Apache-2.0
"""docs/python.ipynb: docs/python.md as a notebook, executed; make notebook writes it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from cfd_pneumatic.files import write_text
from studies.documents.tutorial import programs
from studies.tools.provenance import ROOT

PAGE, NOTEBOOK = (ROOT / 'docs' / f'python.{suffix}' for suffix in ('md', 'ipynb'))

_FENCE = re.compile(r'^```(python|sh)\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def notebook() -> nbformat.NotebookNode:
    """Return the page's notebook, not executed."""
    made = nbformat.v4.new_notebook(cells=list(_cells()))
    for rank, cell in enumerate(made.cells):
        cell.id = f'cell-{rank}'  # a random one would differ each time
    return made


def _cells() -> Iterator[nbformat.NotebookNode]:
    text, end = PAGE.read_text(encoding='utf-8'), 0
    for block in _FENCE.finditer(text):
        yield nbformat.v4.new_markdown_cell(text[end : block.start()].strip())
        yield nbformat.v4.new_code_cell(('!' if block[1] == 'sh' else '') + block[2].rstrip())
        end = block.end()
    yield nbformat.v4.new_markdown_cell(text[end:].strip())


def executed(folder: Path) -> nbformat.NotebookNode:
    """Return the notebook with its outputs; it runs in a kernel of its own, in a folder."""
    made = notebook()
    NotebookClient(made, timeout=600, resources={'metadata': {'path': str(folder)}}).execute(
        env=programs(folder / 'programs')
    )
    return made


def main() -> None:
    """Write the notebook."""
    with tempfile.TemporaryDirectory() as folder:
        write_text(NOTEBOOK, nbformat.writes(executed(Path(folder))) + '\n')


if __name__ == '__main__':
    main()
