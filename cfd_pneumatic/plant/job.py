# SPDX-License-Identifier: Apache-2.0
"""One bag from beginning to end, wherever it is done."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, check_folder, marked, read_input, write_text
from cfd_pneumatic.identification import VARIABLES, identify
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.plant.fingerprint import Settings, fingerprint
from cfd_pneumatic.plant.result_table import FAILED, FITTED, Row, column_of
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.reporting import PAGE_FILE, REPORT_FILE, REPORT_FILES, file_names, write_report

ROW_FILE = 'row.json'
"""Beside a bag's report: its rows of the table, and what they follow from."""

_LARGEST_ROWS = 2**24  # bytes; three rows, with what was amiss with a recording, have a thousandth of that

FILES = ResultFiles(REPORT_FILES.recognitions | {ROW_FILE: marked(r'\A\{\s*"fingerprint": "[0-9a-f]+",\s*"rows": ')})
"""How the files in a bag's folder are recognised."""

_FIRST_DATE = 631_152_000_000_000_000
"""The year 1990 [ns]: a clock that says less counts from something else than 1970."""

_alone = Lock()  # Matplotlib's settings are one for all threads, and a worker may have several


@dataclass(frozen=True)
class Job:
    """
    What a worker needs to do a bag; small, for it is sent there.

    Attributes
    ----------
    bag
        Path of the bag, absolute.
    folder
        Where the results go, absolute.
    settings
        How to read and identify it.
    fingerprint
        What the results follow from.
    overwrite
        Whether files in the folder are replaced that this program did not write.

    """

    bag: Path
    folder: Path
    settings: Settings
    fingerprint: str
    overwrite: bool = False


def earlier_rows(job: Job) -> list[Row] | None:
    """Return the rows of a job that was done before and would come out the same, or None."""
    try:
        # an interruption or a person may have left anything there
        earlier = json.loads(read_input(job.folder / ROW_FILE, _LARGEST_ROWS))
        return list(earlier['rows']) if earlier['fingerprint'] == job.fingerprint else None
    except (InputError, ValueError, LookupError, TypeError, RecursionError):
        return None


def check_files(job: Job) -> None:
    """
    Refuse a job that would replace files which this program did not write.

    Raises
    ------
    InputError
        If there is one in its folder.

    """
    names = [*file_names(1, closed=job.settings.options.close_loop), ROW_FILE]
    FILES.check_files(job.folder, names, overwrite=job.overwrite)


def do(job: Job) -> list[Row]:
    """
    Do a job: read the bag, identify it, write its folder of results, and return its rows of the table.

    The folder is there with all that belongs into it, or not at all.

    Raises
    ------
    InputError
        If this is not the bag, or not the program, that was meant, or the folder can't be written.

    """
    if fingerprint(job.bag, job.settings) != job.fingerprint:
        raise InputError('it changed meanwhile, or this worker sees another one or has another version of the program')
    check_folder(job.folder)
    check_files(job)
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    with _alone, FILES.staged_output(job.folder, overwrite=job.overwrite) as folder:
        rows = _identified(job, folder)
        text = json.dumps({'fingerprint': job.fingerprint, 'rows': rows}, indent=1, allow_nan=False)
        write_text(folder / ROW_FILE, f'{text}\n')
    return rows


def _identified(job: Job, folder: Path) -> list[Row]:
    """Return the rows of a bag, which is one with the reason where there is no result."""
    settings = job.settings
    time = None
    try:
        recording = read_recording(
            job.bag,
            mapping=settings.mapping,
            namespace=settings.namespace,
            ambient_pressure=settings.options.ambient_pressure,
        )
        time = recording.epoch if recording.epoch >= _FIRST_DATE else None
        identification = identify([recording], settings.options)
    except InputError as error:
        return [failure(str(error).removeprefix(f'{job.bag}: ')) | {'time': time}]
    write_report(identification, folder)
    report = json.loads((folder / REPORT_FILE).read_text(encoding='utf-8'))
    page = PAGE_FILE if (folder / PAGE_FILE).is_file() else REPORT_FILE
    return rows_of(report, time, page)


def failure(reason: str) -> Row:
    """Return the row of a bag that gave no result."""
    return {'part': '', 'verdict': FAILED, 'reason': ' '.join(reason.split())}


def rows_of(report: Mapping[str, Any], time: int | None, page: str) -> list[Row]:
    """
    Return the rows that stand for a report.

    Parameters
    ----------
    report
        Content of a `report.json` on one recording.
    time
        When the recording begins [ns since 1970], or None.
    page
        Name of the file to link.

    """
    (recording,) = report['recordings']
    common = {
        'time': time,
        'duration_s': recording['duration_s'],
        'notes': '; '.join(recording['notes']),
        'warnings': ';'.join(dict.fromkeys(one['code'] for one in report['warnings'] if one['level'] == WARNING)),
        'report': page,
    }
    parts = dict(report['cylinders'])
    if 'force' in report:
        parts['force'] = report['force']
    return [{'part': name, **common, **_findings(part), **_numbers(part)} for name, part in parts.items()]


def _findings(part: Mapping[str, Any]) -> Row:
    if 'verdict' not in part:
        untold = (f'{name}: {one["reason"]}' for name, one in part['parameters'].items() if one['reason'])
        return {'verdict': FITTED, 'reason': '; '.join(untold)}
    rivals = dict.fromkeys(rival for ones in part['alternatives'].values() for rival in ones)
    parameters = {
        f'{effect}.{name}': {'value': one['value'], 'std': one['std'], 'unit': one['unit']}
        for effect, ones in part['effect_parameters'].items()
        for name, one in ones.items()
    }
    ratio, law = part['after_over_before'], part['unknown']
    return {
        'verdict': part['verdict'],
        'status': part['status'],
        'reason': part['why'],
        'effects': ';'.join(part['effects']),
        'alternatives': ';'.join(rivals),
        'law': law and f'{law["enters"]} by {VARIABLES[law["against"]].axis}',
        'effect_parameters': json.dumps(parameters) if parameters else None,
        'after_over_before': ratio and ratio['ratio'],
    }


def _numbers(part: Mapping[str, Any]) -> Row:
    """Return errors and parameters by their columns."""
    judged = 'test' if 'test' in part['before'] else 'train'  # all samples, where none were set aside
    row: Row = {'judged_on': 'test' if judged == 'test' else 'all'}
    effects = part.get('effects', [])
    for which in ('before', *(['after'] if effects else [])):
        error = part[which][judged]
        row[column_of('nrmse', '%', which)] = error['nrmse_percent']
        row |= {column_of('rmse', unit, which): error[key] for key, unit in _RMSE.items() if key in error}
    after = part.get('parameters_after', {})
    row |= _estimates(part.get('parameters', {}), '')
    if effects:
        row |= _estimates({name: after[name] for name in NAMES if name in after}, 'after')
    if 'area' in after:
        row |= _estimates({'area': after['area']}, '')
    return row


_RMSE = {'rmse_pa': 'Pa', 'rmse_n': 'N'}


def _estimates(parameters: Mapping[str, Any], which: str) -> Row:
    row = {}
    for name, one in parameters.items():
        row[column_of(name, one['unit'], which)] = one['value']
        row[column_of(name, one['unit'], which, 'std')] = one['std']
    return row
