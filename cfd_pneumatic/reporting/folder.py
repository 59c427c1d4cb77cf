# SPDX-License-Identifier: Apache-2.0
"""The folder of results: each file whole or not at all."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from cfd_pneumatic.device import identified_device, is_parameter_file, live_errors, run_line
from cfd_pneumatic.files import ResultFiles, checksum, marked
from cfd_pneumatic.identification import Identification, PartError
from cfd_pneumatic.reporting.comparison import is_comparison, write_comparison
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.reporting.names import COMPARE_FILE, PAGE_FILE, PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.reporting.page import report_page
from cfd_pneumatic.reporting.template import is_page

_COMPARE_FILES = COMPARE_FILE.replace('.', r'(_\d+)?\.')
_RUN_LENGTH = 16
_BESIDE = 1_000_000  # samples, of more than which the page is made first: both at once take memory


FILES = ResultFiles(
    {
        PARAMETER_FILE: is_parameter_file,
        PAGE_FILE: is_page,
        _COMPARE_FILES: is_comparison,
        REPORT_FILE: marked(r'\A\{\s*"schema": \d+,\s*"recordings": '),
    }
)
"""How the results of an identification are recognised. The report is the last to take its place."""


class Written(NamedTuple):
    """What was written."""

    files: list[Path]

    complete: bool
    """Whether files with samples hold every one."""

    live: Mapping[str, PartError]
    """Errors of a live simulation, by channel."""

    checksum: str
    """Of the report."""


def file_names(recordings: int, *, closed: bool) -> list[str]:
    """Return the names of the files that are written about some recordings, whether or not the loop is closed."""
    names = [PARAMETER_FILE, REPORT_FILE]
    return [*names, PAGE_FILE, *_compare_files(recordings)] if closed else names


def write_report(
    identification: Identification, folder: Path, *, full: bool = False, overwrite: bool = False
) -> Written:
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
    overwrite
        Whether files of these names are replaced that this program did not write.

    Raises
    ------
    InputError
        If the folder can't be written, another run writes into it, or a file in it is not to be replaced.

    """
    with FILES.made_for(folder, overwrite=overwrite) as made:
        written = _written(identification, made, full)
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
    return Written([report, *files], all(complete), live, checksum(report))


def compare_files(identification: Identification, folder: Path) -> list[Path]:
    """Return the bag of each recording: `compare.mcap`, or `compare_1.mcap` and so on where there are several."""
    return [folder / name for name in _compare_files(len(identification.recordings))]


def _compare_files(recordings: int) -> list[str]:
    numbers = [''] if recordings == 1 else [f'_{rank}' for rank in range(1, recordings + 1)]
    return [COMPARE_FILE.replace('.', f'{number}.') for number in numbers]


def is_compare_file(path: Path) -> bool:
    """Return whether a file has the name of such a bag."""
    return re.fullmatch(_COMPARE_FILES, path.name) is not None
