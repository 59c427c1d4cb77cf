# SPDX-License-Identifier: Apache-2.0
"""One bag: what its row says, and when it need not be done again."""

from __future__ import annotations

import json
import os
from dataclasses import replace

import pytest
from generated import FIRST, SHIFT, step, still, write_shift
from identified import closed, with_force

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options
from cfd_pneumatic.plant.fingerprint import Settings, fingerprint
from cfd_pneumatic.plant.job import ROW_FILE, Job, earlier_rows, report_rows, run_job
from cfd_pneumatic.plant.result_table import COLUMNS
from cfd_pneumatic.recording import write_recording
from cfd_pneumatic.reporting import report_data

SETTINGS = Settings(Options())


def job_on(bag, folder, settings=SETTINGS):
    return Job(bag, folder, settings, fingerprint(bag, settings))


@pytest.fixture
def bag(tmp_path):
    return write_shift(tmp_path / 'bags' / 'shift', step(0), 3)


def test_a_row_says_what_the_report_says(bag, tmp_path):
    rows = run_job(job_on(bag, tmp_path / 'out'))
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())
    assert [row['part'] for row in rows] == list(report['cylinders']) == ['cylinder_a', 'cylinder_b']
    for row, part in zip(rows, report['cylinders'].values()):
        parameters = part['parameters']
        assert row['k_x_pa_per_m'] == parameters['k_x']['value']
        assert row['tau_std_s'] == parameters['tau']['std']
        assert row['k_sv_per_s'] == parameters['k_sv']['value']
        assert row['rmse_before_pa'] == part['before']['train']['rmse_pa']
        assert (row['judged_on'], row['verdict'], row['report']) == ('all', 'fitted', 'report.json')
        assert row['time'] == FIRST + 3 * SHIFT
        assert set(row) <= {column.name for column in COLUMNS}


def test_rows_of_a_closed_loop_tell_before_and_after():
    report = report_data(with_force(closed()))
    rows = {row['part']: row for row in report_rows(report, FIRST, 'report.html')}
    droop, fine, force = rows['cylinder_a'], rows['cylinder_b'], rows['force']
    part = report['cylinders']['cylinder_a']
    assert droop['verdict'] == part['verdict']
    assert droop['effects'] == 'droop'
    assert droop['judged_on'] == 'test'
    assert droop['rmse_before_pa'] == part['before']['test']['rmse_pa']
    assert droop['rmse_after_pa'] == part['after']['test']['rmse_pa'] < droop['rmse_before_pa']
    assert droop['after_over_before'] == part['after_over_before']['ratio']
    assert droop['k_x_after_pa_per_m'] == part['parameters_after']['k_x']['value'] != droop['k_x_pa_per_m']
    slope = json.loads(droop['effect_parameters'])['droop.slope']
    assert slope['std'] == part['effect_parameters']['droop']['slope']['std']
    assert fine['verdict'] == 'no_missing_effect'
    assert 'rmse_after_pa' not in fine
    assert 'k_x_after_pa_per_m' not in fine
    assert force['rmse_before_n'] == report['force']['before']['test']['rmse_n']
    assert force['area_m2'] == report['force']['parameters_after']['area']['value']
    assert 'rmse_before_pa' not in force
    assert set().union(*rows.values()) <= {column.name for column in COLUMNS}


def test_a_clock_that_does_not_count_from_1970_tells_no_time(tmp_path):
    write_recording(tmp_path / 'bag', replace(step(0), epoch=5 * 10**9))
    assert run_job(job_on(tmp_path / 'bag', tmp_path / 'out'))[0]['time'] is None


def test_a_bag_that_fails_is_one_row_with_its_reason_alone_in_its_folder(tmp_path):
    bag = write_shift(tmp_path / 'still', still(), 2)
    (row,) = run_job(job_on(bag, tmp_path / 'out'))
    assert (row['part'], row['verdict'], row['time']) == ('', 'failed', FIRST + 2 * SHIFT)
    assert 'does not move' in row['reason']
    assert str(tmp_path) not in row['reason']
    assert [path.name for path in (tmp_path / 'out').iterdir()] == [ROW_FILE]


def test_a_damaged_bag_is_a_row(tmp_path):
    (tmp_path / 'damaged.mcap').write_bytes(b'\x89MCAP0\r\nthis is none')
    (row,) = run_job(job_on(tmp_path / 'damaged.mcap', tmp_path / 'out'))
    assert row['verdict'] == 'failed'
    assert 'damaged' in row['reason'] or 'cut off' in row['reason']


def test_what_was_done_is_not_done_again_until_bag_or_settings_change(bag, tmp_path):
    job = job_on(bag, tmp_path / 'out')
    assert earlier_rows(job) is None
    rows = run_job(job)
    assert earlier_rows(job_on(bag, tmp_path / 'out')) == rows
    assert earlier_rows(job_on(bag, tmp_path / 'out', Settings(Options(close_loop=True)))) is None
    os.utime(next(bag.glob('*.mcap')), ns=(FIRST, FIRST))
    assert earlier_rows(job_on(bag, tmp_path / 'out')) is None


@pytest.mark.parametrize('left', ['', '{"rows": []', '[]', '{}', '{"fingerprint": 3, "rows": 4}'])
def test_whatever_lies_in_the_place_of_a_row_it_is_done_again(bag, tmp_path, left):
    job = job_on(bag, tmp_path / 'out')
    job.folder.mkdir()
    (job.folder / ROW_FILE).write_text(left)
    assert earlier_rows(job) is None


def test_new_results_replace_earlier_ones_and_what_a_dead_worker_left(bag, tmp_path):
    folder = tmp_path / 'out' / 'shift'
    (folder.parent / '.shift~dead0000').mkdir(parents=True)
    (folder.parent / '.shift.2~alive000').mkdir()
    run_job(job_on(bag, folder, Settings(Options(close_loop=True))))
    assert (folder / 'compare.mcap').exists()
    run_job(job_on(bag, folder))
    assert sorted(path.name for path in folder.parent.iterdir()) == ['.shift.2~alive000', 'shift']
    assert sorted(path.name for path in folder.iterdir()) == ['parameters.yaml', 'report.json', ROW_FILE]


def test_what_is_somebody_s_own_in_a_bag_s_folder_stays(bag, tmp_path):
    job = job_on(bag, tmp_path / 'out')
    run_job(job)
    (job.folder / 'notes').write_text('mine')
    run_job(job)
    assert sorted(path.name for path in job.folder.iterdir()) == ['notes', 'parameters.yaml', 'report.json', ROW_FILE]
    (job.folder / 'report.json').write_text('mine')
    with pytest.raises(InputError, match=r'report\.json exists and may be yours'):
        run_job(job)
    assert (job.folder / 'report.json').read_text() == 'mine'
    run_job(replace(job, overwrite=True))
    assert (job.folder / 'notes').read_text() == 'mine'
    assert earlier_rows(job) is not None


def test_another_bag_than_was_meant_is_refused_and_earlier_results_stay(bag, tmp_path):
    job = job_on(bag, tmp_path / 'out')
    run_job(job)
    before = {path.name: path.read_bytes() for path in job.folder.iterdir()}
    with pytest.raises(InputError, match='the bag changed after the start'):
        run_job(replace(job, fingerprint='of another'))
    assert {path.name: path.read_bytes() for path in job.folder.iterdir()} == before
