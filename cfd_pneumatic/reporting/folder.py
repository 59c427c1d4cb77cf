# SPDX-License-Identifier: Apache-2.0
"""The folder of results, in which every file is complete or absent."""

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

_COMPARE_PATTERN = COMPARE_FILE.replace('.', r'(_\d+)?\.')
_RUN_LENGTH = 16
_MOST_PARALLEL = 1_000_000  # samples; above, the page and the bags are written in turn to save memory


FILES = ResultFiles(
    {
        PARAMETER_FILE: is_parameter_file,
        PAGE_FILE: is_page,
        _COMPARE_PATTERN: is_comparison,
        REPORT_FILE: marked(r'\A\{\s*"schema": \d+,\s*"recordings": '),
    }
)
"""Files of an identification, with the marks that recognise them. The report is the last to be put in place."""


class Written(NamedTuple):
    """The result files of an identification, and what the console reports of them."""

    files: list[Path]

    complete: bool
    """Whether the comparison files hold every sample."""

    live: Mapping[str, PartError]
    """Errors of `sim_node`, which simulates sample by sample, by channel."""

    checksum: str
    """SHA-256 of the report."""


def file_names(recordings: int, *, closed: bool) -> list[str]:
    """Return the names of the result files for a number of recordings, with or without closed loop."""
    names = [PARAMETER_FILE, REPORT_FILE]
    return [*names, PAGE_FILE, *_compare_names(recordings)] if closed else names


def write_report(
    identification: Identification, folder: Path, *, full: bool = False, overwrite: bool = False, scripts: str = ''
) -> Written:
    """
    Write the result files of an identification; earlier files stay until the new files are complete.

    `report.json` and `parameters.yaml` are always written, `report.html` and `compare.mcap` if the loop was closed. If
    the loop was not closed, earlier versions of the last two are removed: they belong to another identification. All
    files carry the name of the run. `report.json` is put in place last and has the checksums of the other files.

    Parameters
    ----------
    identification, folder
        Results to write, and the folder for the files. A missing folder is created.
    full
        Whether `compare.mcap` holds every sample, regardless of the number.
    overwrite
        Whether files of these names are replaced even if this program did not write them.
    scripts
        Relative address of scripts that several pages share; empty to put the scripts into the page.

    Raises
    ------
    InputError
        If the folder cannot be written, another run is writing into it, or a file in it must not be replaced.

    """
    with FILES.made_for(folder, overwrite=overwrite) as staged_folder:
        written = _write_files(identification, staged_folder, full, scripts)
    return written._replace(files=[folder / path.name for path in written.files])


def _write_files(identification: Identification, folder: Path, full: bool, scripts: str) -> Written:
    """Write the result files into an empty folder, the report last."""
    device = identified_device(identification)
    live = live_errors(identification, device)
    data = report_data(identification, live)
    run = hashlib.sha256((json.dumps(data) + device.text).encode()).hexdigest()[:_RUN_LENGTH]
    parameters, page, report = folder / PARAMETER_FILE, folder / PAGE_FILE, folder / REPORT_FILE
    parameters.write_text(f'{run_line(run)}\n{device.text}', encoding='utf-8')
    files, complete = [parameters], []
    if identification.closed:
        bags = compare_files(identification, folder)
        with ThreadPoolExecutor(1) as executor:  # compiled code writes the bags and leaves a processor to the page
            text = executor.submit(report_page, identification, live, run, scripts)
            if sum(len(recording.displacement) for recording in identification.recordings) > _MOST_PARALLEL:
                text.result()
            complete = [write_comparison(bag, identification, index, run, full=full) for index, bag in enumerate(bags)]
        page.write_text(text.result(), encoding='utf-8')
        files += [page, *bags]
    data |= {'run': run, 'files': {path.name: checksum(path) for path in files}}
    report.write_text(json.dumps(data, indent=2, allow_nan=False) + '\n', encoding='utf-8')
    return Written([report, *files], all(complete), live, checksum(report))


def compare_files(identification: Identification, folder: Path) -> list[Path]:
    """Return the path of each recording's bag: `compare.mcap`, or `compare_1.mcap` and so on for several recordings."""
    return [folder / name for name in _compare_names(len(identification.recordings))]


def _compare_names(recordings: int) -> list[str]:
    numbers = [''] if recordings == 1 else [f'_{rank}' for rank in range(1, recordings + 1)]
    return [COMPARE_FILE.replace('.', f'{number}.') for number in numbers]


def is_compare_file(path: Path) -> bool:
    """Return whether a file has the name of a comparison bag."""
    return re.fullmatch(_COMPARE_PATTERN, path.name) is not None
