# SPDX-License-Identifier: Apache-2.0
"""Write docs/licences.md: the licence of each package that is installed: `make licences`."""

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

Of the packages that `make setup`, `make lint` and `make colcon` install, as the packages state them. `make licences`
writes this page of what `requirements/ci.txt` locks. This package itself: Apache-2.0.

## Running

{running}

## Testing and building

{developing}
"""


def main() -> None:
    needed = closure(Requirement(RUNNING), set())
    page = PAGE.format(running=by_licence(locked() & needed), developing=by_licence(locked() - needed))
    (ROOT / 'docs' / 'licences.md').write_text(page, encoding='utf-8')


def locked() -> set[str]:
    """Return the names of the packages that are locked."""
    names = re.findall(r'^([^#=]+)==', LOCK.read_text(encoding='utf-8'), re.MULTILINE)
    return {canonicalize_name(name) for name in names}


def closure(wanted: Requirement, found: set[str]) -> set[str]:
    """Return the names of all that a package and its extras need; what is found already is not asked again."""
    found.add(canonicalize_name(wanted.name))
    for one in map(Requirement, requires(wanted.name) or ()):
        taken = one.marker is None or any(one.marker.evaluate({'extra': extra}) for extra in ('', *wanted.extras))
        if taken and (one.extras or canonicalize_name(one.name) not in found):
            closure(one, found)
    return found


def by_licence(names: Iterable[str]) -> str:
    groups = defaultdict(list)
    for name in sorted(names):
        groups[licence(name)].append(name)
    return table(('licence', 'packages'), ((licence, ', '.join(groups[licence])) for licence in sorted(groups)))


def licence(name: str) -> str:
    """Return what a package says of its licence in a line; ROS's say it in their package.xml only."""
    said = metadata(name)
    for line in [*said.get_all('License-Expression', []), *said.get_all('License', [])]:
        if '\n' not in line and line != 'UNKNOWN':
            return str(line)
    classifiers = [one.split(' :: ')[-1] for one in said.get_all('Classifier', []) if one.startswith('License ::')]
    description = Path(sys.prefix, 'share', re.sub('^ros-(jazzy-)?', '', name).replace('-', '_'), 'package.xml')
    if not classifiers and description.exists():
        classifiers = [one.text or '' for one in ElementTree.parse(description).getroot().iter('license')]
    return ', '.join(classifiers) or 'not stated'


if __name__ == '__main__':
    main()
