# SPDX-License-Identifier: Apache-2.0
"""Write the gallery: the effects with their plots, and reports of recordings that the virtual rig makes."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from cfd_pneumatic.identification import readable_name, sentence, title, verdict
from cfd_pneumatic.model import EFFECTS
from studies.documents.markdown import table
from studies.documents.site.links import SCHEME
from studies.documents.tutorial import programs, run
from studies.tools.provenance import ROOT

PICTURES = ROOT / 'docs' / 'reference' / 'effects'
REPORTS = 'reports'
"""Folder of the report pages in the site."""

EFFECTS_PAGE = """# Gallery of effects

Each plot shows a device with an effect, minus the model of the healthy device. The virtual rig makes the recordings.
A plot leads to the equations, parameters and code of its effect.

:::{{container}} gallery
{cards}
:::
"""

REPORTS_PAGE = """# Gallery of reports

The build of this site makes each recording on the virtual rig. Then the build runs `identify_bag --close-loop` on the
recording. A link opens the complete report page.

{reports}
"""


class Example(NamedTuple):
    """A recording of the virtual rig: name of the report, what the rig simulates, command."""

    name: str
    subject: str
    command: str


EXAMPLES = (
    Example('healthy', 'A healthy device', 'record_rig out_and_back --device paper --output bag'),
    Example(
        'dead_band',
        'Regulator A does not react to errors below 300 Pa',
        'record_rig surface_following --device paper --faults effects_a.dead_band=300 --duration 20 --output bag',
    ),
    Example(
        'mains_hum',
        'The pressure sensor of cylinder A picks up mains hum, which no known effect explains',
        'record_rig surface_following --device paper --faults effects_a.hum=150 --duration 20 --output bag',
    ),
)


def effects_page() -> str:
    """Return the gallery of effects in Markdown."""
    names = [path.stem for path in sorted(PICTURES.glob('*.svg')) if path.stem in EFFECTS]
    return EFFECTS_PAGE.format(cards='\n'.join(map(_card, names)))


def _card(name: str) -> str:
    picture = f'../reference/{PICTURES.name}/{name}.svg'
    return (
        f'- [![Residual that {readable_name(name)} causes]({picture})](../reference/effects.md#{name})\n\n'
        f'  **{readable_name(name).capitalize()}.** {sentence(EFFECTS[name].description)}\n'
    )


def write_reports(folder: Path, examples: Iterable[Example] = EXAMPLES) -> str:
    """Write the report of each example into a folder, and return the gallery of reports in Markdown."""
    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(2) as executor:
        environment = programs(Path(name, 'bin'))
        rows = executor.map(lambda example: _report(example, Path(name), folder, environment), examples)
        reports = table(('recording', 'command', 'verdict', 'report'), rows)
    return REPORTS_PAGE.format(reports=reports)


def _report(example: Example, folder: Path, pages: Path, environment: dict[str, str]) -> tuple[str, ...]:
    """Record and identify an example, keep its report page, and return its row of the table."""
    place = folder / example.name
    place.mkdir()
    run(f'{example.command}\nidentify_bag bag --close-loop --output found', place, environment)
    (place / 'found' / 'report.html').rename(pages / f'{example.name}.html')
    data = json.loads((place / 'found' / 'report.json').read_text(encoding='utf-8'))
    link = f'[open the report]({SCHEME}:{REPORTS}/{example.name}.html)'
    return example.subject, f'`{re.sub(" --output bag$", "", example.command)}`', verdicts(data['cylinders']), link


def verdicts(cylinders: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the verdict on each cylinder of a report as text."""
    return '; '.join(
        f'{title(name)}: {verdict(found["verdict"])}'
        + (f', {" and ".join(map(readable_name, found["effects"]))}' if found['effects'] else '')
        for name, found in cylinders.items()
    )
