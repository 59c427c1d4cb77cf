# SPDX-License-Identifier: Apache-2.0
"""Convert an executed notebook to a page of Markdown with its outputs."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

_ESCAPE = re.compile(r'\x1b\[[0-9;]*[A-Za-z]')


def notebook_page(notebook: Path, page: Path, change: Callable[[str], str] = str) -> str:
    """
    Return the text of a notebook's page; write the notebook's pictures next to the page.

    Parameters
    ----------
    notebook
        The executed notebook.
    page
        File of the page in the site; its name is the beginning of the pictures' names.
    change
        Returns the text of a cell of Markdown for the site.

    """
    cells = json.loads(notebook.read_text(encoding='utf-8'))['cells']
    pictures = iter(page.with_name(f'{page.stem}_{number}.png') for number in range(1, 1000))
    return '\n\n'.join(part for cell in cells for part in _cell(cell, pictures, change)) + '\n'


def _cell(cell: dict[str, Any], pictures: Iterator[Path], change: Callable[[str], str]) -> Iterator[str]:
    source = ''.join(cell['source'])
    if cell['cell_type'] == 'markdown':
        yield change(source)
        return
    is_command = source.startswith('!')
    yield _block('sh' if is_command else 'python', source.removeprefix('!'))
    for output in cell['outputs']:
        yield _output(output, pictures)


def _output(output: dict[str, Any], pictures: Iterator[Path]) -> str:
    data = output.get('data', {})
    if 'image/png' in data:
        path = next(pictures)
        path.write_bytes(base64.b64decode(''.join(data['image/png'])))
        return f'![Output of the cell above]({path.name})'
    text = ''.join(output.get('text', data.get('text/plain', output.get('traceback', ''))))
    plain = _ESCAPE.sub('', text).replace('\r\n', '\n').rstrip('\n')
    return _block('{code-block} text', f':class: output\n\n{plain}')


def _block(language: str, text: str) -> str:
    return f'```{language}\n{text}\n```'
