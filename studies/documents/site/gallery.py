# SPDX-License-Identifier: Apache-2.0
"""Write the gallery: the effects with their plots, and reports of recordings that the virtual rig makes."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from cfd_pneumatic.identification import readable_name, sentence, title, verdict
from cfd_pneumatic.model import EFFECTS
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

The build of this site runs the commands of each example. The virtual rig makes the recordings.

{reports}
"""

REPORT = """## {example.subject}

[Open the report]({link}). {verdicts}.

```sh
{commands}
```
"""


class Example(NamedTuple):
    """
    A recording of the virtual rig.

    Attributes
    ----------
    name
        Name of the recording and of the report.
    subject
        The simulated device, as a heading.
    rig
        Arguments of `record_rig`, without the output.

    """

    name: str
    subject: str
    rig: str

    @property
    def commands(self) -> str:
        """The commands that write the report."""
        identify = f'identify_bag {self.name} --close-loop --output {self.name}_report'
        return f'record_rig {self.rig} --output {self.name}\n{identify}'


EXAMPLES = (
    Example('healthy', 'A healthy device', 'out_and_back --device paper'),
    Example(
        'dead_band',
        'A dead band of regulator A',
        'surface_following --device paper --faults effects_a.dead_band=300 --duration 20',
    ),
    Example(
        'mains_hum',
        'Mains hum, which no known effect explains',
        'surface_following --device paper --faults effects_a.hum=150 --duration 20',
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
        reports = '\n'.join(executor.map(lambda example: _report(example, Path(name), folder, environment), examples))
    return REPORTS_PAGE.format(reports=reports)


def _report(example: Example, folder: Path, pages: Path, environment: dict[str, str]) -> str:
    """Record and identify an example, keep its report page, and return its section of the gallery."""
    run(example.commands, folder, environment)
    written = folder / f'{example.name}_report'
    (written / 'report.html').rename(pages / f'{example.name}.html')
    data = json.loads((written / 'report.json').read_text(encoding='utf-8'))
    link = f'{SCHEME}:{REPORTS}/{example.name}.html'
    return REPORT.format(example=example, link=link, verdicts=verdicts(data['cylinders']), commands=example.commands)


def verdicts(cylinders: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the verdict on each cylinder of a report as text."""
    return '; '.join(
        f'{title(name)}: {verdict(found["verdict"])}'
        + (f', {" and ".join(map(readable_name, found["effects"]))}' if found['effects'] else '')
        for name, found in cylinders.items()
    )
