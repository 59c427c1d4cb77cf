# SPDX-License-Identifier: Apache-2.0
"""The folder of results: each file whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from cfd_pneumatic.device.file import run_line
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.device.live_error import live_errors
from cfd_pneumatic.files import Aside, alone_in, checksum, make_folder, reported, write_through
from cfd_pneumatic.identification import Identification, PartError
from cfd_pneumatic.reporting.comparison import write_comparison
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.reporting.names import COMPARE_FILE, PAGE_FILE, PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.reporting.page import report_page

_RUN_LENGTH = 16
_BESIDE = 1_000_000  # samples, of more than which the page is made first: both at once take memory


class Written(NamedTuple):
    """Files that were written, whether those with samples hold every one, and the errors of a live simulation."""

    files: list[Path]
    complete: bool
    live: Mapping[str, PartError]


def write_report(identification: Identification, folder: Path, *, full: bool = False) -> Written:
    """
    Write the results into a folder, made if need be; earlier files stay until the new ones are whole.

    `report.json` and `parameters.yaml` always; `report.html` and `compare.mcap` where the loop was closed. Where it was
    not, earlier ones of these are removed: they would tell of another identification. All carry one run's name, and
    `report.json`, the last to take its place, the checksums of the others.

    Parameters
    ----------
    identification, folder
        What, and where to.
    full
        Whether `compare.mcap` holds every sample, however many there are.

    Raises
    ------
    InputError
        If the folder can't be written, or somebody else writes results into it.

    """
    make_folder(folder)
    with alone_in(folder), reported(folder):
        place = folder.resolve()  # a link stays one
        shared = place == Path.cwd() or not all(is_result(path) for path in folder.iterdir())
        aside = Aside(place / 'results' if shared else place)
        try:
            aside.made.mkdir()
            written = _written(identification, aside.made, full)
            if shared:  # what is somebody's own stays where it is
                _move(written.files, folder)
            else:
                aside.take_place()
        finally:
            aside.close()
    return written._replace(files=[folder / path.name for path in written.files])


def _written(identification: Identification, folder: Path, full: bool) -> Written:
    """Write the results into an empty folder, the report last."""
    device = identified_device(identification)
    live = live_errors(identification, device)
    data = report_data(identification, live)
    run = hashlib.sha256((json.dumps(data) + device.text).encode()).hexdigest()[:_RUN_LENGTH]
    parameters, page, report = folder / PARAMETER_FILE, folder / PAGE_FILE, folder / REPORT_FILE
    parameters.write_text(f'{run_line(run)}\n{device.text}', encoding='utf-8')
    files, complete = [parameters], []
    if identification.closed:
        compared = compare_files(identification, folder)
        with ThreadPoolExecutor(1) as beside:  # bags are written by what is compiled, which lets the page be made
            text = beside.submit(report_page, identification, live, run)
            if sum(len(one.displacement) for one in identification.recordings) > _BESIDE:
                text.result()
            complete = [
                write_comparison(path, identification, index, run, full=full) for index, path in enumerate(compared)
            ]
        page.write_text(text.result(), encoding='utf-8')
        files += [page, *compared]
    data |= {'run': run, 'files': {path.name: checksum(path) for path in files}}
    report.write_text(json.dumps(data, indent=2, allow_nan=False) + '\n', encoding='utf-8')
    return Written([report, *files], all(complete), live)


def _move(files: Sequence[Path], folder: Path) -> None:
    """Move results into a folder that holds something else, too, the report last; take away earlier ones."""
    report, *others = files
    write_through(report.parent)
    for path in folder.iterdir():
        if path.is_file() and is_result(path) and path.name not in {one.name for one in files}:
            path.unlink()
    for path in (*others, report):
        os.replace(path, folder / path.name)


def is_result(path: Path) -> bool:
    """Return whether a file has a name of ours."""
    return path.name in (REPORT_FILE, PARAMETER_FILE, PAGE_FILE) or is_compare_file(path)


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
