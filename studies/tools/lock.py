# SPDX-License-Identifier: Apache-2.0
"""
Lock what CI installs, by version and by hash: `make lock`.

The requirements are given as arguments, as pip takes them. Printed is what pip would install of them here, a line each:
for this version of Python, on this kind of machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

ASK = 'install --dry-run --ignore-installed --no-build-isolation --quiet --report -'
"""What pip is asked to say what it would install."""


def main(requirements: Sequence[str]) -> None:
    command = [sys.executable, '-m', 'pip', *ASK.split(), *requirements]
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    print(f'# Written by make lock, for Python {sys.version_info.major}.{sys.version_info.minor} on Linux, x86_64.')
    print(*sorted(line(one) for one in report['install'] if 'archive_info' in one['download_info']), sep='\n')


def line(package: dict[str, Any]) -> str:
    name, version = package['metadata']['name'], package['metadata']['version']
    return f'{name.lower()}=={version} --hash=sha256:{package["download_info"]["archive_info"]["hashes"]["sha256"]}'


if __name__ == '__main__':
    main(sys.argv[1:])
