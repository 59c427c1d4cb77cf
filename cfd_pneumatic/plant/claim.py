"""One run at a time in a folder of results."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cfd_pneumatic.errors import InputError


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """
    Keep other runs from claiming a folder meanwhile, so far as its file system can.

    Raises
    ------
    InputError
        If another one has claimed it.

    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise InputError(f'{folder} is being written to by another run: wait for its end') from error
    except OSError:  # file systems of a network may have no locks
        pass
    try:
        yield
    finally:
        os.close(handle)
