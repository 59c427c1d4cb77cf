"""Writing a result so that a reader finds the old one or the new one, never half of either."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from cfd_pneumatic.errors import InputError


def write_text(path: Path, text: str) -> None:
    """
    Write a text file aside and rename it into place.

    Raises
    ------
    InputError
        If the folder can't be written.

    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """
    Write a file aside and rename it into place.

    Raises
    ------
    InputError
        If the folder can't be written.

    """
    try:
        handle, aside = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
    except OSError as error:
        raise InputError(f'cannot write {path}: {error.strerror}; choose a folder that you may write to') from error
    try:
        with os.fdopen(handle, 'wb') as stream:
            stream.write(content)
        os.chmod(aside, 0o644)
        os.replace(aside, path)
    except BaseException:
        os.unlink(aside)
        raise


def make_folder(folder: Path) -> None:
    """
    Make an output folder, so that a bad one is found before the work is done.

    Raises
    ------
    InputError
        If it can't be made or written.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / '.writable', '')
        (folder / '.writable').unlink()
    except OSError as error:
        raise InputError(
            f'cannot write to {folder}: {error.strerror}; choose a folder that you may write to'
        ) from error
