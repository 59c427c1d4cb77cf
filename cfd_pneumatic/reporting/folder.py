"""The folder of results: each file whole or not at all."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import NamedTuple

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Identification
from cfd_pneumatic.reporting.comparison import write_comparison
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.reporting.names import COMPARE_FILE, PAGE_FILE, PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.reporting.parameters import parameter_file


class Written(NamedTuple):
    """Files that were written, and whether every sample is in those that hold samples."""

    files: list[Path]
    complete: bool


def write_report(identification: Identification, folder: Path, *, full: bool = False) -> Written:
    """
    Write the results into a folder, made if need be; earlier files stay until the new ones are whole.

    `report.json` and `parameters.yaml` always; `report.html` and `compare.mcap` where the loop was closed. Where it was
    not, earlier ones of these are removed: they would tell of another identification.

    Parameters
    ----------
    identification, folder
        What, and where to.
    full
        Whether `compare.mcap` holds every sample, however many there are.

    Raises
    ------
    InputError
        If the folder can't be written.

    """
    make_folder(folder)
    files = {
        folder / REPORT_FILE: json.dumps(report_data(identification), indent=2, allow_nan=False) + '\n',
        folder / PARAMETER_FILE: parameter_file(identification),
    }
    if identification.closed:
        from cfd_pneumatic.reporting.page import report_page  # with Matplotlib, whose import takes its time

        files[folder / PAGE_FILE] = report_page(identification)
    for path, text in files.items():
        write_text(path, text)
    compared = compare_files(identification, folder) if identification.closed else []
    complete = [write_comparison(path, identification, index, full=full) for index, path in enumerate(compared)]
    _remove_outdated(folder, {*files, *compared})
    return Written([*files, *compared], all(complete))


def compare_files(identification: Identification, folder: Path) -> list[Path]:
    """Return the bag of each recording: `compare.mcap`, or `compare_1.mcap` and so on where there are several."""
    count = len(identification.recordings)
    base = Path(COMPARE_FILE)
    if count == 1:
        return [folder / base]
    return [folder / f'{base.stem}_{rank}{base.suffix}' for rank in range(1, count + 1)]


def is_compare_file(path: Path) -> bool:
    """Return whether a file has the name of such a bag."""
    base = Path(COMPARE_FILE)
    return re.fullmatch(rf'{base.stem}(_\d+)?', path.stem) is not None and path.suffix == base.suffix


def _remove_outdated(folder: Path, written: set[Path]) -> None:
    """Remove earlier results of the kinds that not every identification writes."""
    for path in folder.iterdir():
        if (path.name == PAGE_FILE or is_compare_file(path)) and path not in written and path.is_file():
            path.unlink()


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
