# SPDX-License-Identifier: Apache-2.0
"""`identify_bag --each` as a plant runs it: interrupted, killed, on a cluster, and twice."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from generated import BAGS, FIRST, SHIFT, SHIFTS, start, step, still, tables, wait_for, write_plant, write_shift
from patience import LONG_PATIENCE, allowed, wait_until
from pyarrow import parquet

from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.files.staging import exclusive_access
from cfd_pneumatic.plant.result_table import iso_time

DASK = [sys.executable, '-m', 'dask']


def finish(process):
    """Return what a program printed; it must have ended well, with nothing to complain of."""
    printed, complaints = process.communicate(timeout=allowed(LONG_PATIENCE))
    assert (process.returncode, complaints) == (0, '')
    return printed


def asides(folder):
    return [path for path in folder.rglob('.*') if '~' in path.name]


def test_a_row_for_each_cylinder_of_each_bag(small_results):
    with (small_results / 'results.csv').open(newline='', encoding='utf-8') as stream:
        rows = list(csv.DictReader(stream))
    assert [(row['device'], row['time'], row['bag'], row['part']) for row in rows] == [
        (f'cell_{device}', iso_time(FIRST + shift * SHIFT), f'plant/cell_{device}/shift_{shift + 1}', part)
        for device in (1, 2, 3)
        for shift in range(SHIFTS)
        for part in ('cylinder_a', 'cylinder_b')
    ]
    for row in rows:
        assert (small_results / row['report']).is_file()
        assert 3e6 < float(row['k_x_pa_per_m']) < 6e6
    assert parquet.read_table(small_results / 'results.parquet').num_rows == len(rows)


@pytest.mark.slow
def test_bags_that_fail_are_rows_the_others_finish_and_what_is_mended_is_done_again_and_nothing_else(tmp_path, capsys):
    plant, output = tmp_path / 'plant', tmp_path / 'out'
    write_plant(plant, 1, 2)
    write_shift(plant / 'cell_1' / 'still', still(), 5)
    torn = plant / 'cell_2' / 'torn'
    torn.mkdir(parents=True)
    (torn / 'metadata.yaml').write_text('nothing of the kind')
    (plant / 'cell_2' / 'broken.mcap').write_bytes(b'nothing of the kind')
    (plant / 'cell_2' / 'shift.bag').write_bytes(b'')
    barred = write_shift(plant / 'cell_3' / 'barred', step(1), 0)
    output.mkdir()
    (output / 'cell_3').write_text('in the way')
    arguments = [str(plant), str(tmp_path / 'gone.mcap'), '--each', '--jobs', '1', '--output', str(output)]

    def rows():
        assert identify_bag(arguments) == 0
        return capsys.readouterr().out, parquet.read_table(output / 'results.parquet').to_pylist()

    said, found = rows()
    assert said.startswith('8 bags of 4 devices, 6 failed\n')
    reasons = {Path(row['bag']).name: row['reason'] for row in found if row['verdict'] == 'failed'}
    assert reasons.pop('barred').startswith(f'cannot write {output / "cell_3" / "barred"}: Not a directory; choose ')
    assert set(reasons) == {'still', 'torn', 'broken.mcap', 'shift.bag', 'gone.mcap'}
    assert 'does not move' in reasons['still']
    assert 'does not exist' in reasons['gone.mcap']
    assert all(reason and '\n' not in reason and 'unexpected' not in reason for reason in reasons.values())
    assert [row['verdict'] for row in found].count('fitted') == 4
    (output / 'cell_3').unlink()
    shutil.rmtree(torn)
    write_shift(torn, step(0), 0)
    old = {path: path.stat().st_ino for path in output.rglob('shift_*/row.json')}
    assert len(old) == 2
    (output / 'cell_1' / '.shift_1~left0000' / 'shift_1').mkdir(parents=True)  # by a worker that died when it was done
    (output / 'cell_1' / '.mine~').touch()
    said, found = rows()
    assert said.startswith('8 bags of 4 devices, 4 failed; ')
    mended = {str(torn), str(barred)}
    assert {row['verdict'] for row in found if row['bag'] in mended} == {'fitted'}
    assert {path: path.stat().st_ino for path in old} == old
    assert [path.name for path in asides(output)] == ['.mine~']


def test_a_folder_of_another_run_and_an_address_of_no_scheduler_are_refused(small, tmp_path, capsys):
    folder, other = tmp_path / 'folder', tmp_path / 'other'
    folder.mkdir()
    with exclusive_access(folder):
        assert identify_bag([str(small), '--each', '--jobs', '1', '--output', str(folder)]) == 2
    assert 'another run' in capsys.readouterr().err
    assert list(folder.iterdir()) == []
    nowhere = ['--scheduler', 'ftp://localhost:1', '--output', str(other)]
    assert identify_bag([str(small), '--each', *nowhere]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith('identify_bag: error: no Dask scheduler answers at ftp://localhost:1')
    assert complaint.count('\n') == 1


# on a cluster that runs already


@contextmanager
def dask(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a part of a Dask cluster as a process group of its own."""
    where = ['--scheduler-file', str(folder / 'scheduler.json'), '--no-dashboard']
    with (folder / 'log').open('ab') as log:
        process = subprocess.Popen([*DASK, *arguments, *where], stdout=log, stderr=log, start_new_session=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
        process.wait(allowed(LONG_PATIENCE))


def address_of(folder: Path) -> str:
    """Return the address of the scheduler once it is there."""

    def address() -> str | None:
        try:
            return json.loads((folder / 'scheduler.json').read_text())['address']
        except (OSError, ValueError):
            return None

    return wait_until(address, found=(folder / 'log').read_text)


def begun(small, output, *arguments):
    return start('plant', '--each', '--output', output, *arguments, cwd=small.parent)


@pytest.mark.slow
def test_interrupted_and_killed_it_goes_on_where_it_stopped(small, small_results, tmp_path):
    def done():
        return sum('~' not in str(row.relative_to(tmp_path)) for row in tmp_path.rglob('row.json'))  # none left aside

    run = begun(small, tmp_path, '--jobs', 1)
    wait_for(run, 3)
    os.killpg(run.pid, signal.SIGINT)  # as Ctrl-C does: the workers hear it, too
    _, complaints = run.communicate(timeout=allowed(LONG_PATIENCE))
    assert run.returncode == 130
    assert complaints == 'identify_bag: interrupted. Run the same command again to continue\n'
    interrupted = done()
    assert 3 <= interrupted < BAGS
    assert asides(tmp_path) == []
    run = begun(small, tmp_path, '--jobs', 1)
    wait_for(run, 3)
    os.killpg(run.pid, signal.SIGKILL)
    run.communicate()
    killed = done()
    assert interrupted + 3 <= killed < BAGS
    assert not (tmp_path / 'results.csv').exists()
    assert f'{BAGS - killed} of {BAGS - killed} bags' in finish(begun(small, tmp_path, '--jobs', 1))
    assert tables(tmp_path) == tables(small_results)
    assert asides(tmp_path) == []


@pytest.mark.long
def test_a_cluster_is_waited_for_may_lose_a_worker_and_ends_a_run_where_it_is_lost(small, small_results, tmp_path):
    out, lost = tmp_path / 'out', tmp_path / 'lost'
    worker = ('worker', '--nthreads', '1', '--host', '127.0.0.1')
    with dask(tmp_path, 'scheduler', '--host', '127.0.0.1', '--port', '0') as scheduler:
        there = ('--scheduler', address_of(tmp_path))
        run = begun(small, out, *there)
        assert any('waiting for `dask worker`' in line for line in run.stdout)
        with dask(tmp_path, *worker) as doomed, dask(tmp_path, *worker):
            wait_for(run, BAGS // 2)
            os.killpg(doomed.pid, signal.SIGKILL)
            assert f'{BAGS} of {BAGS} bags' in finish(run)
            assert tables(out) == tables(small_results)
            assert asides(out) == []
            run = begun(small, lost, *there)
            wait_for(run, 3)
            os.killpg(scheduler.pid, signal.SIGKILL)
            _, complaint = run.communicate(timeout=allowed(LONG_PATIENCE))
    assert run.returncode == 2
    assert complaint.startswith('identify_bag: error: the connection to the Dask scheduler was lost')
    assert complaint.count('\n') == 1
