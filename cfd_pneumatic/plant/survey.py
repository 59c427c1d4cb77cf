# SPDX-License-Identifier: Apache-2.0
"""All bags of a plant, each identified once, and what they come to."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from distributed import Client, KilledWorker

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, remove_abandoned, write_text
from cfd_pneumatic.plant.bags import PlantBag
from cfd_pneumatic.plant.cluster import results
from cfd_pneumatic.plant.fingerprint import Settings, fingerprint
from cfd_pneumatic.plant.history import devices
from cfd_pneumatic.plant.index_page import index_page
from cfd_pneumatic.plant.job import Job, check_files, do, earlier_rows, failure
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

FILES = ResultFiles({CSV_FILE: is_csv_table, PARQUET_FILE: is_parquet_table, INDEX_FILE: is_page})
"""How the files in a plant's folder are recognised."""

_NAMED = 10  # devices in a summary

Progress = Callable[[str, float], None]
"""Called with what is being done and which share of the whole is done [0 to 1]."""


@dataclass(frozen=True)
class Survey:
    """
    What came of a plant.

    Attributes
    ----------
    rows
        Of the table, by device, time and bag.
    taken_over
        How many bags had been done before.
    files
        What was written, besides a folder for each bag.

    """

    rows: tuple[Row, ...]
    taken_over: int
    files: tuple[Path, ...]

    @property
    def summary(self) -> str:
        """What came of it, in a line or two for people."""
        plant = devices(self.rows)
        bags, failed = sum(len(one.bags) for one in plant), sum(len(one.failures) for one in plant)
        changed = [one.name for one in plant if one.changes]
        print_help_or_version = f'{count_of(bags, "bag")} of {count_of(len(plant), "device")}, {failed} failed'
        if self.taken_over:
            print_help_or_version += f'; {self.taken_over} had been done before'
        if changed:
            more = f' and {len(changed) - _NAMED} more' if len(changed) > _NAMED else ''
            print_help_or_version += f'\nanother verdict than before: {", ".join(changed[:_NAMED])}{more}'
        return print_help_or_version


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
    Identify each bag that was not done before, and write the table and the index of all.

    Parameters
    ----------
    bags
        Of the plant.
    settings
        How to read and identify them.
    folder
        For the results.
    cluster
        Where the work is done; not entered where there is none to do.
    progress
        Told of each bag that is done.
    overwrite
        Whether files are replaced that this program did not write.

    Raises
    ------
    InputError
        If the folder can't be written, a file is not to be replaced, or the cluster is not there, or lost.

    """
    jobs = {_job(bag, settings, folder, overwrite): bag for bag in bags}
    _clear(jobs)
    rows: list[Row] = []
    todo = []
    for job, bag in jobs.items():
        earlier = earlier_rows(job)
        if earlier is None:
            todo.append(job)
        else:
            rows += _placed(earlier, bag)
    _check_files(folder, todo, overwrite)
    tally = _Tally(len(todo), progress)
    if todo:
        progress('starting the workers', 0.0)
        with cluster as client:
            tally.tell()
            for job, result in results(client, do, todo, tally.wait):
                found = [failure(_reason(result))] if isinstance(result, Exception) else result
                rows += _placed(found, jobs[job])
                tally.add(found)
    rows.sort(key=_order)
    progress('writing the table', 1.0)
    files = write_table(rows, folder)
    write_text(folder / INDEX_FILE, index_page(rows))
    return Survey(tuple(rows), len(jobs) - len(todo), (*files, folder / INDEX_FILE))


def _job(bag: PlantBag, settings: Settings, folder: Path, overwrite: bool) -> Job:
    path = bag.path.absolute()
    return Job(path, folder.absolute() / bag.folder, settings, fingerprint(path, settings), overwrite)


def _clear(jobs: Iterable[Job]) -> None:
    """Take away what workers that died left aside: of a bag that was done, nobody else would."""
    names = defaultdict(set)
    for job in jobs:
        names[job.folder.parent].add(job.folder.name)
        names[job.folder].add(job.folder.name)
    for folder, those in names.items():
        remove_abandoned(folder, those)


def _check_files(folder: Path, jobs: Iterable[Job], overwrite: bool) -> None:
    """Refuse to replace files that this program did not write, before there is any work."""
    FILES.check_files(folder, overwrite=overwrite)
    for job in jobs:
        check_files(job)


class _Tally:
    """How many bags are done, told as it grows."""

    def __init__(self, total: int, progress: Progress) -> None:
        self.total = total
        self.progress = progress
        self.done = 0
        self.failed = 0

    def add(self, rows: Sequence[Row]) -> None:
        """Count a bag."""
        self.done += 1
        self.failed += any(row['verdict'] == FAILED for row in rows)
        self.tell()

    def tell(self) -> None:
        """Say how many are done."""
        self._say(f', {self.failed} failed' if self.failed else '')

    def wait(self) -> None:
        """Say that there are no workers."""
        self._say(': no workers, waiting for `dask worker`')

    def _say(self, more: str) -> None:
        self.progress(f'{self.done} of {self.total} bags{more}', self.done / self.total)


def _reason(error: Exception) -> str:
    """Return why a job was not done, which is another matter than a bag that can't be identified."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, KilledWorker):
        return 'every worker that took it died, for want of memory perhaps: identify it alone'
    return f'unexpected {type(error).__name__}: {error}; identify it alone to see where'


def _placed(rows: Sequence[Row], bag: PlantBag) -> Iterator[Row]:
    """Yield a bag's rows with what only the plant knows: whose they are, and where their report is."""
    for row in rows:
        report = {'report': (bag.folder / row['report']).as_posix()} if 'report' in row else {}
        yield {'device': bag.device, 'bag': str(bag.path), **row, **report}


_PARTS = ('', *CYLINDERS, 'force')


def _order(row: Row) -> tuple[str, bool, int, str, int]:
    time = row.get('time')
    return row['device'], time is None, time or 0, row['bag'], _PARTS.index(row['part'])
