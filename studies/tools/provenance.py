# SPDX-License-Identifier: Apache-2.0
"""Describe the provenance of a figure: version of the program, commit and machine."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get('CFD_PNEUMATIC_DATA') or ROOT.parent / 'shared' / 'data') / 'pneumatic_actuator'
"""Folder of the measured runs."""


def code_version() -> str:
    """Return a fingerprint of the package's source text."""
    texts = [path.read_bytes() for path in sorted((ROOT / 'cfd_pneumatic').rglob('*.py'))]
    return hashlib.sha256(b''.join(texts)).hexdigest()[:12]


def commit() -> str:
    """Return the current commit, with a note if files of the package differ from it."""
    try:
        head = subprocess.check_output(['git', 'rev-parse', '--short', 'HEAD'], cwd=ROOT, text=True).strip()
        changed = subprocess.check_output(['git', 'status', '--porcelain', 'cfd_pneumatic'], cwd=ROOT, text=True)
    except (OSError, subprocess.CalledProcessError):
        return 'unknown'
    return f'{head} with changes' if changed.strip() else head


def machine() -> str:
    """Describe this machine: processor, cores, memory, Python."""
    model = platform.processor() or platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        names = [line.partition(':')[2].strip() for line in info.read_text().splitlines() if 'model name' in line]
        model = names[0] if names else model
    memory = os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30
    return (
        f'{model}, {os.cpu_count()} cores, {memory:.0f} GiB of memory; '
        f'Python {platform.python_version()}, NumPy {np.__version__}'
    )
