"""`identify_bag --each` as a plant runs it: interrupted, killed, on a cluster, and twice."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from generated import (
    BAGS,
    FIRST,
    PROGRAM,
    SHIFT,
    SHIFTS,
    start,
    step,
    still,
    tables,
    wait_for,
    write_plant,
    write_shift,
)
from pyarrow import parquet

from cfd_pneumatic.plant import claimed
from cfd_pneumatic.plant.table import iso_time

DASK = [sys.executable, '-m', 'dask']
_PATIENCE = 600.0  # for a whole plant on a busy machine [s]


def finish(process):
    """Return what a program printed; it must have ended well, with nothing to complain of."""
    printed, complaints = process.communicate(timeout=_PATIENCE)
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


def test_twice_gives_the_same_bytes_and_does_nothing_again(small, small_results, tmp_path):
    again = tmp_path / 'results'
    shutil.copytree(small_results, again)
    shutil.rmtree(again / 'cell_2' / 'shift_3')
    for name in tables(again):
        (again / name).unlink()
    old = {path: path.stat().st_ino for path in again.rglob('row.json')}
    finish(start('plant', '--each', '--output', again, cwd=small.parent))
    assert tables(again) == tables(small_results)
    assert {path: path.stat().st_ino for path in old} == old


def test_interrupted_it_goes_on_where_it_stopped(small, small_results, tmp_path):
    arguments = ('plant', '--each', '--jobs', 2, '--output', tmp_path)
    run = start(*arguments, cwd=small.parent)
    wait_for(run, 5)
    os.killpg(run.pid, signal.SIGINT)  # as Ctrl-C does: the workers hear it, too
    _, complaints = run.communicate(timeout=_PATIENCE)
    assert run.returncode == 130
    assert complaints == 'identify_bag: interrupted: give the same command again to go on\n'
    done = len(list(tmp_path.rglob('row.json')))
    assert 5 <= done < BAGS
    assert not (tmp_path / 'results.csv').exists()
    printed = finish(start(*arguments, cwd=small.parent))
    assert f'{BAGS - done} of {BAGS - done} bags' in printed
    assert tables(tmp_path) == tables(small_results)
    assert asides(tmp_path) == []


def test_killed_it_goes_on_where_it_stopped(small, small_results, tmp_path):
    arguments = ('plant', '--each', '--jobs', 2, '--output', tmp_path)
    run = start(*arguments, cwd=small.parent)
    wait_for(run, 5)
    os.killpg(run.pid, signal.SIGKILL)
    run.communicate()
    assert 5 <= len(list(tmp_path.rglob('row.json'))) < BAGS
    finish(start(*arguments, cwd=small.parent))
    assert tables(tmp_path) == tables(small_results)
    assert asides(tmp_path) == []


def test_bags_that_fail_are_rows_and_the_others_finish(tmp_path):
    plant = tmp_path / 'plant'
    write_plant(plant, 1, 2)
    write_shift(plant / 'cell_1' / 'still', still(), 5)
    (plant / 'cell_2').mkdir()
    (plant / 'cell_2' / 'broken.mcap').write_bytes(b'nothing of the kind')
    (plant / 'cell_2' / 'shift.bag').write_bytes(b'')
    run = subprocess.run(
        [*PROGRAM, str(plant), str(tmp_path / 'gone.mcap'), '--each', '--jobs', '2', '--output', str(tmp_path / 'out')],
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.startswith('6 bags of 3 devices, 4 failed\n')
    rows = parquet.read_table(tmp_path / 'out' / 'results.parquet').to_pylist()
    reasons = {Path(row['bag']).name: row['reason'] for row in rows if row['verdict'] == 'failed'}
    assert set(reasons) == {'still', 'broken.mcap', 'shift.bag', 'gone.mcap'}
    assert 'does not move' in reasons['still']
    assert 'does not exist' in reasons['gone.mcap']
    assert all(reason and '\n' not in reason and 'unexpected' not in reason for reason in reasons.values())
    assert [row['verdict'] for row in rows].count('fitted') == 4


def test_a_bag_mended_is_done_again(tmp_path):
    bag = tmp_path / 'cell' / 'shift'
    bag.mkdir(parents=True)
    (bag / 'metadata.yaml').write_text('nothing of the kind')
    verdicts = []
    for _ in range(2):
        finish(start(tmp_path / 'cell', '--each', '--jobs', 1, '--output', tmp_path / 'out'))
        table = parquet.read_table(tmp_path / 'out' / 'results.parquet')
        verdicts.append(set(table['verdict'].to_pylist()))
        shutil.rmtree(bag)
        write_shift(bag, step(0), 0)
    assert verdicts == [{'failed'}, {'fitted'}]


def test_what_is_unexpected_is_a_row_too_and_tried_again(small, small_results, tmp_path):
    (tmp_path / 'cell_2').write_text('in the way')
    arguments = ('plant', '--each', '--jobs', 1, '--output', tmp_path)
    finish(start(*arguments, cwd=small.parent))
    rows = parquet.read_table(tmp_path / 'results.parquet').to_pylist()
    reasons = {row['bag']: row['reason'] for row in rows if row['verdict'] == 'failed'}
    assert set(reasons) == {f'plant/cell_2/shift_{shift}' for shift in range(1, SHIFTS + 1)}
    assert all(reason.startswith('unexpected FileExistsError: ') for reason in reasons.values())
    (tmp_path / 'cell_2').unlink()
    finish(start(*arguments, cwd=small.parent))
    assert tables(tmp_path) == tables(small_results)


def test_two_runs_do_not_write_to_one_folder(small, tmp_path):
    with claimed(tmp_path):
        run = start('plant', '--each', '--jobs', 1, '--output', tmp_path, cwd=small.parent)
        _, complaint = run.communicate(timeout=_PATIENCE)
    assert run.returncode == 2
    assert 'another run' in complaint
    assert list(tmp_path.iterdir()) == []


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
        process.wait(_PATIENCE)


def address_of(folder: Path) -> str:
    """Return the address of the scheduler once it is there."""
    limit = time.monotonic() + _PATIENCE
    while time.monotonic() < limit:
        try:
            return json.loads((folder / 'scheduler.json').read_text())['address']
        except (OSError, ValueError):
            time.sleep(0.05)
    raise TimeoutError((folder / 'log').read_text())


def test_on_a_dask_cluster_that_loses_a_worker_half_way_60_bags_give_the_same_table(tmp_path):
    write_plant(tmp_path / 'plant', 20, 3, alone=True)
    finish(start('plant', '--each', '--jobs', 2, '--output', tmp_path / 'alone', cwd=tmp_path))
    worker = ('worker', '--nthreads', '1', '--host', '127.0.0.1')
    with (
        dask(tmp_path, 'scheduler', '--host', '127.0.0.1', '--port', '0'),
        dask(tmp_path, *worker) as doomed,
        dask(tmp_path, *worker),
    ):
        run = start(
            'plant', '--each', '--scheduler', address_of(tmp_path), '--output', tmp_path / 'cluster', cwd=tmp_path
        )
        wait_for(run, 30)
        os.killpg(doomed.pid, signal.SIGKILL)
        finish(run)
    rows = parquet.read_table(tmp_path / 'cluster' / 'results.parquet')
    assert len(set(rows['bag'].to_pylist())) == 60
    assert set(rows['verdict'].to_pylist()) == {'fitted'}
    assert tables(tmp_path / 'cluster') == tables(tmp_path / 'alone')


def test_a_cluster_without_workers_is_waited_for_and_one_that_is_lost_ends_the_run(small, tmp_path):
    with dask(tmp_path, 'scheduler', '--host', '127.0.0.1', '--port', '0') as scheduler:
        arguments = ('--each', '--scheduler', address_of(tmp_path), '--output', tmp_path / 'out')
        run = start('plant', *arguments, cwd=small.parent)
        assert any('waiting for `dask worker`' in line for line in run.stdout)
        with dask(tmp_path, 'worker', '--nthreads', '1', '--host', '127.0.0.1'):
            wait_for(run, 3)
            os.killpg(scheduler.pid, signal.SIGKILL)
            _, complaint = run.communicate(timeout=_PATIENCE)
    assert run.returncode == 2
    assert complaint.startswith('identify_bag: error: the Dask scheduler was lost')
    assert complaint.count('\n') == 1


def test_an_address_that_is_none(small, tmp_path):
    run = start('plant', '--each', '--scheduler', 'ftp://localhost:1', '--output', tmp_path, cwd=small.parent)
    _, complaint = run.communicate(timeout=_PATIENCE)
    assert run.returncode == 2
    assert complaint.startswith('identify_bag: error: no Dask scheduler answers at ftp://localhost:1')
    assert complaint.count('\n') == 1
