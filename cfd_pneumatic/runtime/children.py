# SPDX-License-Identifier: Apache-2.0
"""
Start Python processes that import nothing from the working folder.

Python searches the working folder first if it is started with `-c` or `-m`. A file named `numpy.py` in that folder
would run in the child process.
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

_DROP_WORKING_FOLDER = 'import sys; sys.path[:] = filter(None, sys.path); '  # an empty entry is the working folder
_IMPORT_PACKAGE = f'sys.path.insert(0, {str(Path(__file__).parents[2])!r}); import cfd_pneumatic; del sys.path[0]; '
"""Code that imports this package from its folder, even if Python would not find it or would find another version."""

_spawn = util.spawnv_passfds


def start_python(code: str, *arguments: str, **options: Any) -> subprocess.Popen[Any]:
    """
    Start Python in a new session, which an interrupt at the terminal does not reach.

    Parameters
    ----------
    code
        Code that Python runs.
    arguments
        Arguments of the code: `sys.argv[1:]`.
    options
        Options of `subprocess.Popen`; `env` is added to this process's environment.

    Raises
    ------
    OSError
        If the system cannot start a process.

    """
    environment = os.environ | options.pop('env', {}) | {'PYTHONPATH': absolute_python_path()}
    command = [sys.executable, '-c', _DROP_WORKING_FOLDER + _IMPORT_PACKAGE + code, *arguments]
    return subprocess.Popen(command, env=environment, start_new_session=True, **options)


def guard_multiprocessing() -> None:
    """Prevent processes that `multiprocessing` or Dask starts from importing from the working folder."""
    if sys.version_info >= (3, 11):
        os.environ['PYTHONSAFEPATH'] = '1'
    else:
        util.spawnv_passfds = _spawn_guarded


def _spawn_guarded(path: bytes, arguments: Sequence[str], descriptors: Sequence[int]) -> int:
    """Start Python as `multiprocessing` does, without the working folder in the import path."""
    index = arguments.index('-c') + 1
    return _spawn(
        path, [*arguments[:index], _DROP_WORKING_FOLDER + arguments[index], *arguments[index + 1 :]], descriptors
    )
