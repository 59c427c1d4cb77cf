# SPDX-License-Identifier: Apache-2.0
"""The job of a worker: a bag from reading to the rows of the result table."""

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
"""File in a bag's folder with the rows of the table and the fingerprint of the job."""

_LARGEST_ROWS = 2**24  # bytes; three rows with their notes have a thousandth of that size

FILES = ResultFiles(REPORT_FILES.recognitions | {ROW_FILE: marked(r'\A\{\s*"fingerprint": "[0-9a-f]+",\s*"rows": ')})
"""Files in a bag's folder, with the marks that recognise them."""

_FIRST_DATE = 631_152_000_000_000_000
"""The year 1990 [ns]. An earlier time means that the clock does not count from 1970."""

_job_lock = Lock()  # a worker may have several threads, which share Matplotlib's settings


@dataclass(frozen=True)
class Job:
    """
    The order to identify a bag; small, because it is sent to a worker.

    Attributes
    ----------
    bag
        Absolute path of the bag.
    folder
        Absolute path of the folder for the results.
    settings
        Settings for reading and identifying the bag.
    fingerprint
        Fingerprint of all that determines the results.
    overwrite
        Whether files in the folder are replaced even if this program did not write them.
    scripts
        Address, relative to the folder, of the scripts that the pages of the plant share; empty if they share none.

    """

    bag: Path
    folder: Path
    settings: Settings
    fingerprint: str
    overwrite: bool = False
    scripts: str = ''


def earlier_rows(job: Job) -> list[Row] | None:
    """Return the rows of an earlier run of the job if its fingerprint is unchanged, else None."""
    try:
        # after an interruption or an edit the file may have any content
        earlier = json.loads(read_input(job.folder / ROW_FILE, _LARGEST_ROWS))
        return list(earlier['rows']) if earlier['fingerprint'] == job.fingerprint else None
    except (InputError, ValueError, LookupError, TypeError, RecursionError):
        return None


def check_files(job: Job) -> None:
    """
    Refuse a job that would replace files that this program did not write.

    Raises
    ------
    InputError
        If the folder of the job has such a file.

    """
    names = [*file_names(1, closed=job.settings.options.close_loop), ROW_FILE]
    FILES.check_files(job.folder, names, overwrite=job.overwrite)


def run_job(job: Job) -> list[Row]:
    """
    Read and identify the bag of a job, write the folder of results, and return the rows of the table.

    The folder is complete or absent.

    Raises
    ------
    InputError
        If the bag or the program is not that of the fingerprint, or the folder cannot be written.

    """
    if fingerprint(job.bag, job.settings) != job.fingerprint:
        raise InputError(
            'the bag changed after the start, or this worker has another bag or another version of the program. '
            'Install the same version on all workers and run the command again'
        )
    check_folder(job.folder)
    check_files(job)
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    with _job_lock, FILES.staged_output(job.folder, overwrite=job.overwrite) as folder:
        rows = _identify_bag(job, folder)
        text = json.dumps({'fingerprint': job.fingerprint, 'rows': rows}, indent=1, allow_nan=False)
        write_text(folder / ROW_FILE, f'{text}\n')
    return rows


def _identify_bag(job: Job, folder: Path) -> list[Row]:
    """Return the rows of a bag, or a single row with the reason if the identification fails."""
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
        return [failed_row(str(error).removeprefix(f'{job.bag}: ')) | {'time': time}]
    write_report(identification, folder, scripts=job.scripts)
    report = json.loads((folder / REPORT_FILE).read_text(encoding='utf-8'))
    page = PAGE_FILE if (folder / PAGE_FILE).is_file() else REPORT_FILE
    return report_rows(report, time, page)


def failed_row(reason: str) -> Row:
    """Return the row of a bag without a result."""
    return {'part': '', 'verdict': FAILED, 'reason': ' '.join(reason.split())}


def report_rows(report: Mapping[str, Any], time: int | None, page: str) -> list[Row]:
    """
    Return the rows of the table for a report, a row for each part of the device.

    Parameters
    ----------
    report
        Content of the `report.json` of a single recording.
    time
        Begin of the recording [ns since 1970], or None.
    page
        Name of the file to which the row links.

    """
    (recording,) = report['recordings']
    common = {
        'time': time,
        'duration_s': recording['duration_s'],
        'notes': '; '.join(recording['notes']),
        'warnings': ';'.join(
            dict.fromkeys(notice['code'] for notice in report['warnings'] if notice['level'] == WARNING)
        ),
        'report': page,
    }
    parts = dict(report['cylinders'])
    if 'force' in report:
        parts['force'] = report['force']
    return [{'part': name, **common, **_findings(part), **_numbers(part)} for name, part in parts.items()]


def _findings(part: Mapping[str, Any]) -> Row:
    if 'verdict' not in part:
        reasons = (f'{name}: {gain["reason"]}' for name, gain in part['parameters'].items() if gain['reason'])
        return {'verdict': FITTED, 'reason': '; '.join(reasons)}
    alternatives = dict.fromkeys(effect for effects in part['alternatives'].values() for effect in effects)
    parameters = {
        f'{effect}.{name}': {'value': estimate['value'], 'std': estimate['std'], 'unit': estimate['unit']}
        for effect, estimates in part['effect_parameters'].items()
        for name, estimate in estimates.items()
    }
    ratio, curve = part['after_over_before'], part['unknown']
    return {
        'verdict': part['verdict'],
        'status': part['status'],
        'reason': part['why'],
        'effects': ';'.join(part['effects']),
        'alternatives': ';'.join(alternatives),
        'law': curve and f'{curve["enters"]} by {VARIABLES[curve["against"]].axis}',
        'effect_parameters': json.dumps(parameters) if parameters else None,
        'after_over_before': ratio and ratio['ratio'],
    }


def _numbers(part: Mapping[str, Any]) -> Row:
    """Return errors and parameters by the names of their columns."""
    judged_part = 'test' if 'test' in part['before'] else 'train'  # without a test part, the train part has all samples
    row: Row = {'judged_on': 'test' if judged_part == 'test' else 'all'}
    effects = part.get('effects', [])
    for which in ('before', *(['after'] if effects else [])):
        error = part[which][judged_part]
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
    for name, estimate in parameters.items():
        row[column_of(name, estimate['unit'], which)] = estimate['value']
        row[column_of(name, estimate['unit'], which, 'std')] = estimate['std']
    return row
