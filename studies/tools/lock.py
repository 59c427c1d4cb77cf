# SPDX-License-Identifier: Apache-2.0
"""
Lock the packages of CI by version and hash: `make lock`.

The arguments are requirements in pip's syntax. The program prints a line for each package that pip would install for
this version of Python on this kind of machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

PIP_ARGUMENTS = 'install --dry-run --ignore-installed --no-build-isolation --quiet --report -'
"""Arguments with which pip reports the packages that it would install."""


def main(requirements: Sequence[str]) -> None:
    command = [sys.executable, '-m', 'pip', *PIP_ARGUMENTS.split(), *requirements]
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    print(f'# Written by make lock, for Python {sys.version_info.major}.{sys.version_info.minor} on Linux, x86_64.')
    print(
        *sorted(line(package) for package in report['install'] if 'archive_info' in package['download_info']), sep='\n'
    )


def line(package: dict[str, Any]) -> str:
    name, version = package['metadata']['name'], package['metadata']['version']
    return f'{name.lower()}=={version} --hash=sha256:{package["download_info"]["archive_info"]["hashes"]["sha256"]}'


if __name__ == '__main__':
    main(sys.argv[1:])
