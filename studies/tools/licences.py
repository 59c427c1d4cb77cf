# SPDX-License-Identifier: Apache-2.0
"""Write docs/reference/licences.md with the licence of each installed package: `make licences`."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from collections.abc import Iterable
from importlib.metadata import metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from studies.documents.markdown import table
from studies.tools.provenance import ROOT

LOCK = ROOT / 'requirements' / 'ci.txt'
RUNNING = 'cfd-pneumatic[jazzy,plant]'

PAGE = """# Licences

Licences of the packages that `make setup`, `make lint` and `make colcon` install, as the packages state them.
`make licences` writes this page from `requirements/ci.txt`. The licence of this package is Apache-2.0.

## Running

{running}

## Testing and building

{developing}
"""


def main() -> None:
    needed = closure(Requirement(RUNNING), set())
    page = PAGE.format(running=by_licence(locked() & needed), developing=by_licence(locked() - needed))
    (ROOT / 'docs' / 'reference' / 'licences.md').write_text(page, encoding='utf-8')


def locked() -> set[str]:
    """Return the names of the locked packages."""
    names = re.findall(r'^([^#=]+)==', LOCK.read_text(encoding='utf-8'), re.MULTILINE)
    return {canonicalize_name(name) for name in names}


def closure(wanted: Requirement, found: set[str]) -> set[str]:
    """Add a package and all its dependencies, with those of its extras, to the found names; return the names."""
    found.add(canonicalize_name(wanted.name))
    for needed in map(Requirement, requires(wanted.name) or ()):
        marker = needed.marker
        applies = marker is None or any(marker.evaluate({'extra': extra}) for extra in ('', *wanted.extras))
        if applies and (needed.extras or canonicalize_name(needed.name) not in found):
            closure(needed, found)
    return found


def by_licence(names: Iterable[str]) -> str:
    groups = defaultdict(list)
    for name in sorted(names):
        groups[licence(name)].append(name)
    return table(('licence', 'packages'), ((licence, ', '.join(groups[licence])) for licence in sorted(groups)))


def licence(name: str) -> str:
    """Return the licence that a package states; packages of ROS state it only in their package.xml."""
    fields = metadata(name)
    for line in [*fields.get_all('License-Expression', []), *fields.get_all('License', [])]:
        if '\n' not in line and line != 'UNKNOWN':
            return str(line)
    classifiers = [text.split(' :: ')[-1] for text in fields.get_all('Classifier', []) if text.startswith('License ::')]
    description = Path(sys.prefix, 'share', re.sub('^ros-(jazzy-)?', '', name).replace('-', '_'), 'package.xml')
    if not classifiers and description.exists():
        classifiers = [element.text or '' for element in ElementTree.parse(description).getroot().iter('license')]
    return ', '.join(classifiers) or 'not stated'


if __name__ == '__main__':
    main()
