# SPDX-License-Identifier: Apache-2.0
"""Pages from templates: HTML that stands alone, in one style."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined

from cfd_pneumatic.identification import wording
from cfd_pneumatic.result_files import marked

TEMPLATES = Path(__file__).parent / 'templates'
_COMPILED = Path(__file__).parent / '__pycache__'

is_page = marked('<meta name="generator" content="cfd_pneumatic ')
"""Recognises a page that a template made."""


def rendered(template: str, *folders: Path, **values: Any) -> str:
    """Return the page that a template makes of some values; `folders` are searched for it before this package's own."""
    kept = FileSystemBytecodeCache(str(_COMPILED)) if os.access(_COMPILED, os.W_OK) else None
    templates = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES]),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=kept,
    )
    templates.filters.update(
        number=wording.number,
        percent=wording.percent,
        qualified=wording.qualified,
        sentence=wording.sentence,
        spoken=wording.spoken,
        title=wording.title,
        title_of_test=wording.title_of_test,
        unit=wording.unit,
        verdict=wording.verdict,
    )
    page = templates.get_template(template).render(**values)
    return '\n'.join(line.rstrip() for line in page.splitlines() if line.strip()) + '\n'
