# SPDX-License-Identifier: Apache-2.0
"""
Start Python processes that import nothing from the working folder.

Python looks there first if it is started with `-c` or `-m`. Whoever put a file named `numpy.py` into that folder would
run code in the child.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from multiprocessing import util
from pathlib import Path
from typing import Any

from cfd_pneumatic.runtime.start import absolute_python_path

_DROP = 'import sys; sys.path[:] = filter(None, sys.path); '  # an empty entry is the working folder
_IMPORT = f'sys.path.insert(0, {str(Path(__file__).parents[2])!r}); import cfd_pneumatic; del sys.path[0]; '
"""Imports the package from where it is, whether or not Python would find it, or another version of it, by itself."""

_spawn = util.spawnv_passfds


def start_python(code: str, *arguments: str, **options: Any) -> subprocess.Popen[Any]:
    """
    Start Python with code and arguments, in a session of its own: an interrupt at the terminal does not reach it.

    Parameters
    ----------
    code, arguments
        What Python runs, and what `sys.argv` holds from its second place on.
    options
        Those of `subprocess.Popen`, except that `env` is added to this process's environment.

    Raises
    ------
    OSError
        If the system cannot start a process.

    """
    environment = os.environ | options.pop('env', {}) | {'PYTHONPATH': absolute_python_path()}
    command = [sys.executable, '-c', _DROP + _IMPORT + code, *arguments]
    return subprocess.Popen(command, env=environment, start_new_session=True, **options)


def guard_multiprocessing() -> None:
    """Let what `multiprocessing` starts from now on, also for Dask, import nothing from the working folder."""
    if sys.version_info >= (3, 11):
        os.environ['PYTHONSAFEPATH'] = '1'
    else:
        util.spawnv_passfds = _spawn_guarded


def _spawn_guarded(path: bytes, arguments: Sequence[str], descriptors: Sequence[int]) -> int:
    """Start Python as `multiprocessing` does, with code that begins as that of `start_python`."""
    place = arguments.index('-c') + 1
    return _spawn(path, [*arguments[:place], _DROP + arguments[place], *arguments[place + 1 :]], descriptors)
