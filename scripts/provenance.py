"""What a figure comes from: the program's version and the machine."""

from __future__ import annotations

import ast
import hashlib
import itertools
import os
import platform
import subprocess
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]


def code_version() -> str:
    """Return a fingerprint of the program text, comments and docstrings apart, that the results depend on."""
    digest = hashlib.sha256()
    package = ROOT / 'cfd_pneumatic'
    folders = (package / name for name in ('identification', 'model', 'recording', 'rig'))
    for path in sorted([*package.glob('*.py'), *itertools.chain.from_iterable(one.rglob('*.py') for one in folders)]):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        for node in ast.walk(tree):
            body = getattr(node, 'body', None)
            if isinstance(body, list):  # a string that stands alone is a docstring
                node.body = [one for one in body if not _is_text(one)]
        digest.update(ast.dump(tree).encode())
    return digest.hexdigest()[:12]


def _is_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def commit() -> str:
    """Return the commit that is checked out, and whether files differ from it."""
    try:
        head = subprocess.check_output(['git', 'rev-parse', '--short', 'HEAD'], cwd=ROOT, text=True).strip()
        changed = subprocess.check_output(['git', 'status', '--porcelain', 'cfd_pneumatic'], cwd=ROOT, text=True)
    except (OSError, subprocess.CalledProcessError):
        return 'unknown'
    return f'{head} with changes' if changed.strip() else head


def machine() -> str:
    """Return what this machine is."""
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
