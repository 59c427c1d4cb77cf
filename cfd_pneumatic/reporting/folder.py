"""The folder of results: each file whole or not at all."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.device.live_error import live_errors
from cfd_pneumatic.files import make_folder, write_text
from cfd_pneumatic.identification import Identification, PartError
from cfd_pneumatic.reporting.comparison import write_comparison
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.reporting.names import COMPARE_FILE, PAGE_FILE, PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.reporting.page import report_page


class Written(NamedTuple):
    """Files that were written, whether those with samples hold every one, and the errors of a live simulation."""

    files: list[Path]
    complete: bool
    live: Mapping[str, PartError]


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
    device = identified_device(identification)
    live = live_errors(identification, device)
    files = {
        folder / REPORT_FILE: json.dumps(report_data(identification, live), indent=2, allow_nan=False) + '\n',
        folder / PARAMETER_FILE: device.text,
    }
    if identification.closed:
        files[folder / PAGE_FILE] = report_page(identification, live)
    for path, text in files.items():
        write_text(path, text)
    compared = compare_files(identification, folder) if identification.closed else []
    complete = [write_comparison(path, identification, index, full=full) for index, path in enumerate(compared)]
    _remove_outdated(folder, {*files, *compared})
    return Written([*files, *compared], all(complete), live)


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
