# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML pages from templates, all in the same style."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from jinja2 import BytecodeCache, Environment, FileSystemLoader, StrictUndefined
from jinja2.bccache import Bucket

from cfd_pneumatic.charts import chart_element
from cfd_pneumatic.files import marked
from cfd_pneumatic.identification import (
    number,
    percent,
    readable_name,
    reservation,
    sentence,
    title_of_test,
    uncertainty,
    unit,
)
from cfd_pneumatic.identification import title as title_text
from cfd_pneumatic.identification import verdict as verdict_text
from cfd_pneumatic.runtime import is_trusted, read_code, write_code

TEMPLATES = Path(__file__).parent / 'templates'
_COMPILED = Path(__file__).parent / '__pycache__'

is_page = marked('<meta name="generator" content="cfd_pneumatic ')
"""Recognise a page that this program wrote."""


class _CompiledTemplates(BytecodeCache):
    """Cache of compiled templates, in checked files. Compiling a template takes 0.2 s."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Load the compiled template of a bucket from its file, if there is a valid file."""
        content = read_code(self._path(bucket))
        if content is not None:
            bucket.bytecode_from_string(content)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write the compiled template of a bucket to its file, if the folder is writable."""
        with suppress(OSError):
            write_code(self._path(bucket), bucket.bytecode_to_string())

    def _path(self, bucket: Bucket) -> Path:
        return _COMPILED / f'{bucket.key}.jbc'


def rendered(template: str, *folders: Path, scripts: str = '', **values: Any) -> str:
    """
    Return the page that a template makes of values.

    Parameters
    ----------
    template
        File name of the template.
    *folders
        Folders that are searched before the templates of this package.
    scripts
        Elements that load the scripts of the plots; empty for a page with static pictures.
    **values
        Values of the template.

    """
    templates = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES]),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_CompiledTemplates() if is_trusted(_COMPILED) else None,
    )
    templates.filters.update(
        figure=partial(chart_element, has_plot=bool(scripts)),
        number=number,
        percent=percent,
        reservation=reservation,
        sentence=sentence,
        readable_name=readable_name,
        title=title_text,
        title_of_test=title_of_test,
        uncertainty=uncertainty,
        unit=unit,
        verdict=verdict_text,
    )
    page = templates.get_template(template).render(**values)
    text = '\n'.join(line.rstrip() for line in page.splitlines() if line.strip()) + '\n'
    return text.replace('</body>', f'{scripts}\n</body>') if scripts else text
