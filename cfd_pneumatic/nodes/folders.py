# SPDX-License-Identifier: Apache-2.0
"""Folders that a node reads and writes for others: anybody in the graph may set the paths in its parameters."""

from __future__ import annotations

import os
import pwd
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from glob import escape
from itertools import islice
from pathlib import Path

from cfd_pneumatic.errors import InputError, printable

INPUTS, OUTPUT = 'input_folders', 'output_folder'
"""Parameters that name the folders."""

_MOST_ENTRIES = 1_000  # of a folder that is read
_LONGEST_SHOWN = 200  # characters of a path in a message


class Folders:
    """
    The folders below which every path from the graph has to be.

    Paths are resolved before they are compared, so that no link leads out. Hidden files and folders are refused: they
    hold keys and settings. A message shows the path as it was given, and nothing of what the path leads to.

    Parameters
    ----------
    inputs
        Folders that may be read. Without any: the working folder, unless the working folder holds the home folder.
    output
        Folder that may be written; '' as above. It need not exist.

    Raises
    ------
    InputError
        If a given folder holds the home folder, or an input folder does not exist.

    """

    def __init__(self, inputs: Sequence[str], output: str) -> None:
        working = Path.cwd().resolve()
        default = () if _holds_home(working) else (working,)
        self._folders = {
            INPUTS: tuple(_given(INPUTS, folder) for folder in inputs) or default,
            OUTPUT: (_given(OUTPUT, output),) if output else default,
        }
        for folder in self._folders[INPUTS]:
            if not folder.is_dir():
                raise InputError(f"{folder} (parameter '{INPUTS}') is not a folder: give folders that exist")

    @property
    def missing(self) -> list[str]:
        """Names of the parameters without which nothing can be read, or written."""
        return [parameter for parameter, folders in self._folders.items() if not folders]

    def check_readable(self, path: str) -> None:
        """
        Check that a file may be read with the files beside it that belong to it, or a folder with all files in it.

        Raises
        ------
        InputError
            If a part lies outside of the input folders, is hidden, or is neither a file nor a folder.

        """
        shown = self._checked(path, INPUTS)
        with _system_errors_of(shown):
            try:
                place = Path(path).resolve(strict=True)
            except FileNotFoundError:
                raise InputError(f'{shown} does not exist: give a path below {INPUTS}') from None
            found = _parts(place)
            if len(found) > _MOST_ENTRIES:
                raise InputError(f'{shown} holds more than {_MOST_ENTRIES:,} files: give the folder of one bag')
            base = place if place.is_dir() else place.parent
            parts = [place, *(part for part in found if not _is_hidden(part.relative_to(base)))]  # readers skip these
            if not all(part.is_file() or part.is_dir() for part in parts):
                raise InputError(f'{shown} is or holds a pipe, a device or a broken link: give files and folders only')
            if not all(self._is_below(part.resolve(), INPUTS) for part in parts):
                raise InputError(f'{shown} holds a link that leads out of {INPUTS}: replace the link by a copy')

    def check_writable(self, path: str) -> None:
        """
        Check that a folder may be written.

        Raises
        ------
        InputError
            If the folder is hidden or not below the output folder: beside the output folder nothing is written.

        """
        shown = self._checked(path, OUTPUT)
        if Path(path).resolve() in self._folders[OUTPUT]:
            raise InputError(f'{shown} is {OUTPUT} itself: name a folder below it')

    def _checked(self, path: str, parameter: str) -> str:
        """Return a path as messages show it, after a check that it is below the folders of a parameter."""
        if not self._folders[parameter]:
            raise InputError(
                f"parameter '{parameter}' is not given, and the node was started in the home folder or above it: "
                f'start the node with {parameter}'
            )
        shown = printable(path)[:_LONGEST_SHOWN]
        with _system_errors_of(shown):
            if self._is_below(Path(path).resolve(), parameter):
                return shown
        raise InputError(
            f'{shown} is hidden or lies outside of {parameter}: move it, or start the node with another {parameter}'
        )

    def _is_below(self, resolved: Path, parameter: str) -> bool:
        """Return whether a path is one of the folders or below it, on a way without hidden folders."""
        return any(
            resolved.is_relative_to(folder) and not _is_hidden(resolved.relative_to(folder))
            for folder in self._folders[parameter]
        )


def _given(parameter: str, text: str) -> Path:
    """Return a folder that was given when the node started."""
    with _system_errors_of(printable(text)):
        folder = Path(text).expanduser().resolve()
    if _holds_home(folder):
        raise InputError(
            f"{folder} (parameter '{parameter}') is the home folder or above it, where keys and settings are: "
            'give a folder of its own'
        )
    return folder


def _holds_home(folder: Path) -> bool:
    homes = [os.path.expanduser('~')]
    with suppress(KeyError):  # a user without a name, as in some containers
        homes.append(pwd.getpwuid(os.getuid()).pw_dir)
    return any(Path(home).resolve().is_relative_to(folder) for home in homes)


def _parts(place: Path) -> list[Path]:
    """Return what is in a folder, at any depth; of a file those beside it that begin alike, as a database's journal."""
    found = place.rglob('*') if place.is_dir() else place.parent.glob(f'{escape(place.name)}-*')
    return list(islice(found, _MOST_ENTRIES + 1))


def _is_hidden(path: Path) -> bool:
    """Return whether a part of a path begins with a dot."""
    return any(part.startswith('.') for part in path.parts)


@contextmanager
def _system_errors_of(shown: str) -> Iterator[None]:
    """Turn what the system has against a path into an error for the user."""
    try:
        yield
    except (OSError, ValueError, RuntimeError) as error:  # no permission; a null character; a loop of links
        raise InputError(f'{shown} cannot be used as a path: give another path') from error
