# SPDX-License-Identifier: Apache-2.0
"""Identification of all bags of a plant, each bag once, into the table and the index page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from distributed import Client, KilledWorker

from cfd_pneumatic.charts import SCRIPT_FILE, is_script_file, shared_scripts
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, remove_abandoned, write_text
from cfd_pneumatic.plant.bags import PlantBag
from cfd_pneumatic.plant.cluster import results
from cfd_pneumatic.plant.fingerprint import Settings, fingerprint
from cfd_pneumatic.plant.history import devices
from cfd_pneumatic.plant.index_page import index_page
from cfd_pneumatic.plant.job import Job, check_files, earlier_rows, failed_row, run_job
from cfd_pneumatic.plant.result_table import (
    CSV_FILE,
    FAILED,
    PARQUET_FILE,
    Row,
    is_csv_table,
    is_parquet_table,
    write_table,
)
from cfd_pneumatic.recording import count_of
from cfd_pneumatic.reporting import is_page

INDEX_FILE = 'index.html'

FILES = ResultFiles(
    {CSV_FILE: is_csv_table, PARQUET_FILE: is_parquet_table, INDEX_FILE: is_page, SCRIPT_FILE: is_script_file}
)
"""Files in the folder of a plant, with the marks that recognise them."""

_MOST_NAMED = 10  # devices that a summary names

Progress = Callable[[str, float], None]
"""Function of the current task and the completed share of the work [0 to 1]."""


@dataclass(frozen=True)
class Survey:
    """
    The results of a plant.

    Attributes
    ----------
    rows
        Rows of the table, sorted by device, time and bag.
    taken_over
        Number of bags with results of an earlier run.
    files
        Written files of the plant. Each bag has a folder of results in addition.

    """

    rows: tuple[Row, ...]
    taken_over: int
    files: tuple[Path, ...]

    @property
    def summary(self) -> str:
        """The results in one line, and the devices with a changed verdict in a second line."""
        plant = devices(self.rows)
        bags, failed = sum(len(device.bags) for device in plant), sum(len(device.failures) for device in plant)
        changed = [device.name for device in plant if device.changes]
        text = f'{count_of(bags, "bag")} of {count_of(len(plant), "device")}, {failed} failed'
        if self.taken_over:
            text += f'; {self.taken_over} taken over from an earlier run'
        if changed:
            more = f' and {len(changed) - _MOST_NAMED} more' if len(changed) > _MOST_NAMED else ''
            text += f'\nchanged verdict: {", ".join(changed[:_MOST_NAMED])}{more}'
        return text


def survey(
    bags: Sequence[PlantBag],
    settings: Settings,
    folder: Path,
    cluster: AbstractContextManager[Client],
    progress: Progress,
    *,
    overwrite: bool = False,
) -> Survey:
    """
    Identify each new or changed bag, and write the table and the index page of all bags.

    Parameters
    ----------
    bags
        Bags of the plant.
    settings
        Settings for reading and identifying the bags.
    folder
        Folder for the results.
    cluster
        Context of the Dask client. It is entered only if there are bags to identify.
    progress
        Called after each bag.
    overwrite
        Whether files are replaced even if this program did not write them.

    Raises
    ------
    InputError
        If the folder cannot be written, a file must not be replaced, or the cluster is not reachable.

    """
    jobs = {_job(bag, settings, folder, overwrite): bag for bag in bags}
    _remove_abandoned(jobs)
    rows: list[Row] = []
    remaining_jobs = []
    for job, bag in jobs.items():
        earlier = earlier_rows(job)
        if earlier is None:
            remaining_jobs.append(job)
        else:
            rows += _plant_rows(earlier, bag)
    _check_files(folder, remaining_jobs, overwrite)
    tally = _Tally(len(remaining_jobs), progress)
    if remaining_jobs:
        progress('starting the workers', 0.0)
        with cluster as client:
            tally.report()
            for job, result in results(client, run_job, remaining_jobs, tally.report_no_workers):
                job_rows = [failed_row(_reason(result))] if isinstance(result, Exception) else result
                rows += _plant_rows(job_rows, jobs[job])
                tally.add(job_rows)
    rows.sort(key=_sort_key)
    progress('writing the table', 1.0)
    files = write_table(rows, folder)
    pages = {INDEX_FILE: index_page(rows)} | ({SCRIPT_FILE: shared_scripts()} if shared_scripts() else {})
    for name, text in pages.items():
        write_text(folder / name, text)
    return Survey(tuple(rows), len(jobs) - len(remaining_jobs), (*files, *(folder / name for name in pages)))


def _job(bag: PlantBag, settings: Settings, folder: Path, overwrite: bool) -> Job:
    path = bag.path.absolute()
    scripts = '../' * len(Path(bag.folder).parts) + SCRIPT_FILE if shared_scripts() else ''
    return Job(path, folder.absolute() / bag.folder, settings, fingerprint(path, settings), overwrite, scripts)


def _remove_abandoned(jobs: Iterable[Job]) -> None:
    """Remove the incomplete folders of workers that died; nothing else removes them after the bag is complete."""
    names = defaultdict(set)
    for job in jobs:
        names[job.folder.parent].add(job.folder.name)
        names[job.folder].add(job.folder.name)
    for folder, folder_names in names.items():
        remove_abandoned(folder, folder_names)


def _check_files(folder: Path, jobs: Iterable[Job], overwrite: bool) -> None:
    """Refuse to replace files that this program did not write, before the work begins."""
    FILES.check_files(folder, overwrite=overwrite)
    for job in jobs:
        check_files(job)


class _Tally:
    """Number of completed and failed bags, reported after each bag."""

    def __init__(self, total: int, progress: Progress) -> None:
        self.total = total
        self.progress = progress
        self.done = 0
        self.failed = 0

    def add(self, rows: Sequence[Row]) -> None:
        """Count a completed bag by its rows."""
        self.done += 1
        self.failed += any(row['verdict'] == FAILED for row in rows)
        self.report()

    def report(self) -> None:
        """Report the number of completed and failed bags."""
        self._report(f', {self.failed} failed' if self.failed else '')

    def report_no_workers(self) -> None:
        """Report that the cluster has no workers."""
        self._report(': no workers, waiting for `dask worker`')

    def _report(self, remark: str) -> None:
        self.progress(f'{self.done} of {self.total} bags{remark}', self.done / self.total)


def _reason(error: Exception) -> str:
    """Return why a worker could not complete a job."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, KilledWorker):
        return 'every worker with this bag died, perhaps for lack of memory. Identify the bag alone'
    return f'unexpected {type(error).__name__}: {error}. Identify the bag alone to see where'


def _plant_rows(rows: Sequence[Row], bag: PlantBag) -> Iterator[Row]:
    """Yield the rows of a bag with the device, the path of the bag and the path of the report."""
    for row in rows:
        report = {'report': (bag.folder / row['report']).as_posix()} if 'report' in row else {}
        yield {'device': bag.device, 'bag': str(bag.path), **row, **report}


_PARTS = ('', *CYLINDERS, 'force')


def _sort_key(row: Row) -> tuple[str, bool, int, str, int]:
    time = row.get('time')
    return row['device'], time is None, time or 0, row['bag'], _PARTS.index(row['part'])
