# SPDX-License-Identifier: Apache-2.0
"""Convert docs/tutorials/python.md to an executed notebook: make notebook writes docs/tutorials/python.ipynb."""

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

PAGE, NOTEBOOK = (ROOT / 'docs' / 'tutorials' / f'python.{suffix}' for suffix in ('md', 'ipynb'))

_FENCE = re.compile(r'^```(python|sh)\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def notebook() -> nbformat.NotebookNode:
    """Return the page as a notebook that is not executed."""
    page = nbformat.v4.new_notebook(cells=list(_cells()))
    for rank, cell in enumerate(page.cells):
        cell.id = f'cell-{rank}'  # nbformat's random id would differ in each run
    return page


def _cells() -> Iterator[nbformat.NotebookNode]:
    text, end = PAGE.read_text(encoding='utf-8'), 0
    for block in _FENCE.finditer(text):
        yield nbformat.v4.new_markdown_cell(text[end : block.start()].strip())
        yield nbformat.v4.new_code_cell(('!' if block[1] == 'sh' else '') + block[2].rstrip())
        end = block.end()
    yield nbformat.v4.new_markdown_cell(text[end:].strip())


def executed(folder: Path) -> nbformat.NotebookNode:
    """Return the notebook with outputs, executed in a folder by a new kernel."""
    page = notebook()
    NotebookClient(page, timeout=600, resources={'metadata': {'path': str(folder)}}).execute(
        env=programs(folder / 'programs')
    )
    return page


def main() -> None:
    """Write the executed notebook."""
    with tempfile.TemporaryDirectory() as folder:
        write_text(NOTEBOOK, nbformat.writes(executed(Path(folder))) + '\n')


if __name__ == '__main__':
    main()
