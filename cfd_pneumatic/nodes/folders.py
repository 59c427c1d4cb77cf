# SPDX-License-Identifier: Apache-2.0
"""Folders that a node may read and write: any node in the graph may set the paths in its parameters."""

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

_MOST_ENTRIES = 1_000  # entries of a folder that is read
_LONGEST_SHOWN = 200  # characters of a path in a message


class Folders:
    """
    The folders below which every path from the graph must be.

    Paths are resolved before the comparison, so that no link leads out. Hidden files and folders are refused: they
    hold keys and settings. A message shows the given path only, not its target.

    Parameters
    ----------
    inputs
        Folders that may be read. Empty: the working folder, unless the working folder holds the home folder.
    output
        Folder that may be written; it need not exist. Empty: as above.

    Raises
    ------
    InputError
        If a given folder holds the home folder, or an input folder does not exist.

    """

    def __init__(self, inputs: Sequence[str], output: str) -> None:
        working = Path.cwd().resolve()
        default = () if _holds_home(working) else (working,)
        self._folders = {
            INPUTS: tuple(_resolve_folder(INPUTS, folder) for folder in inputs) or default,
            OUTPUT: (_resolve_folder(OUTPUT, output),) if output else default,
        }
        for folder in self._folders[INPUTS]:
            if not folder.is_dir():
                raise InputError(f"{folder} (parameter '{INPUTS}') is not a folder: give folders that exist")

    @property
    def missing(self) -> list[str]:
        """Names of the parameters that are required for reading or writing but have no folder."""
        return [parameter for parameter, folders in self._folders.items() if not folders]

    def check_readable(self, path: str) -> None:
        """
        Check that a file with its accompanying files, or a folder with all its files, may be read.

        Raises
        ------
        InputError
            If a file is outside the input folders, is hidden, or is neither a file nor a folder.

        """
        shown_path = self._check_below(path, INPUTS)
        with _reporting_path_errors(shown_path):
            try:
                place = Path(path).resolve(strict=True)
            except FileNotFoundError:
                raise InputError(f'{shown_path} does not exist: give a path below {INPUTS}') from None
            entries = _files_at(place)
            if len(entries) > _MOST_ENTRIES:
                raise InputError(f'{shown_path} holds more than {_MOST_ENTRIES:,} files: give the folder of one bag')
            base = place if place.is_dir() else place.parent
            parts = [place, *(part for part in entries if not _is_hidden(part.relative_to(base)))]  # readers skip these
            if not all(part.is_file() or part.is_dir() for part in parts):
                raise InputError(
                    f'{shown_path} is or holds a pipe, a device or a broken link: give files and folders only'
                )
            if not all(self._is_below(part.resolve(), INPUTS) for part in parts):
                raise InputError(f'{shown_path} holds a link that leads out of {INPUTS}: replace the link by a copy')

    def check_writable(self, path: str) -> None:
        """
        Check that a folder may be written.

        Raises
        ------
        InputError
            If the folder is hidden or not below the output folder.

        """
        shown_path = self._check_below(path, OUTPUT)
        if Path(path).resolve() in self._folders[OUTPUT]:
            raise InputError(f'{shown_path} is {OUTPUT} itself: name a folder below it')

    def _check_below(self, path: str, parameter: str) -> str:
        """Check that a path is below the folders of a parameter; return the path as messages show it."""
        if not self._folders[parameter]:
            raise InputError(
                f"parameter '{parameter}' is not given, and the node was started in the home folder or above it: "
                f'start the node with {parameter}'
            )
        shown_path = printable(path)[:_LONGEST_SHOWN]
        with _reporting_path_errors(shown_path):
            if self._is_below(Path(path).resolve(), parameter):
                return shown_path
        raise InputError(
            f'{shown_path} is hidden or outside {parameter}: move it, or start the node with another {parameter}'
        )

    def _is_below(self, resolved: Path, parameter: str) -> bool:
        """Return whether a path is a folder of the parameter, or below a folder, without hidden parts."""
        return any(
            resolved.is_relative_to(folder) and not _is_hidden(resolved.relative_to(folder))
            for folder in self._folders[parameter]
        )


def _resolve_folder(parameter: str, text: str) -> Path:
    """Resolve a folder that a parameter gives at the start of the node."""
    with _reporting_path_errors(printable(text)):
        folder = Path(text).expanduser().resolve()
    if _holds_home(folder):
        raise InputError(
            f"{folder} (parameter '{parameter}') is the home folder or above it, where keys and settings are: "
            'give a separate folder'
        )
    return folder


def _holds_home(folder: Path) -> bool:
    homes = [os.path.expanduser('~')]
    with suppress(KeyError):  # a user without a name, as in some containers
        homes.append(pwd.getpwuid(os.getuid()).pw_dir)
    return any(Path(home).resolve().is_relative_to(folder) for home in homes)


def _files_at(place: Path) -> list[Path]:
    """Return the entries of a folder at any depth, or the accompanying files of a file, as a database's journal."""
    entries = place.rglob('*') if place.is_dir() else place.parent.glob(f'{escape(place.name)}-*')
    return list(islice(entries, _MOST_ENTRIES + 1))


def _is_hidden(path: Path) -> bool:
    """Return whether a part of a path begins with a dot."""
    return any(part.startswith('.') for part in path.parts)


@contextmanager
def _reporting_path_errors(shown_path: str) -> Iterator[None]:
    """Turn the system's errors on a path into an error for the user."""
    try:
        yield
    except (OSError, ValueError, RuntimeError) as error:  # no permission; a null character; a loop of links
        raise InputError(f'{shown_path} cannot be used as a path: give another path') from error
