# SPDX-License-Identifier: Apache-2.0
"""Programs replace their own results, and files of somebody else only with `--overwrite`."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest

from cfd_pneumatic.commands.dask_certificate import main as dask_certificate
from cfd_pneumatic.commands.force_on_path import main as force_on_path
from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.commands.leak_test import main as leak_test
from cfd_pneumatic.commands.plan_experiment import main as plan_experiment
from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.path import PREVIEW_FILES
from cfd_pneumatic.planning.report import FILES as PLAN_FILES
from cfd_pneumatic.recording import BagWriter
from cfd_pneumatic.reporting.folder import FILES as REPORT_FILES

RESULTS = {
    identify_bag: ['compare.mcap', 'parameters.yaml', 'report.html', 'report.json'],
    plan_experiment: ['plan.json', 'schedule.csv', 'schedule.svg'],
    leak_test: ['leak.json', 'leak.svg'],
    force_on_path: ['preview.json', 'preview.mcap', 'report.html', 'schedule.csv'],
}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'strokes'
    assert record_rig(['out_and_back', '--device', 'paper', '--output', str(path)]) == 0
    return path


@pytest.fixture(scope='module')
def results(bag, tmp_path_factory):
    """Return a folder of results with the loop closed."""
    folder = tmp_path_factory.mktemp('results') / 'found'
    assert identify_bag([str(bag), '--close-loop', '--output', str(folder)]) == 0
    return folder


@pytest.fixture(scope='module')
def arguments(bag, results):
    """Return the arguments of each program, but for its output."""
    device = str(results / 'parameters.yaml')
    surface = results.with_name('surface.csv')
    surface.write_text('along_mm,error_mm\n0,0\n50,0.5\n100,0\n')
    return {
        identify_bag: [str(bag), '--close-loop', '--progress', 'none'],
        plan_experiment: [device, '--duration', '3', '--wanted', 'k_x', '--sample-rate', '50'],
        leak_test: [str(bag)],
        force_on_path: [str(surface), '--device', str(results), '--force', '20N', '--feed', '50mm/s'],
    }


def refusal(capsys, program, *arguments):
    """Return the one line with which a program refuses before it does anything."""
    capsys.readouterr()
    assert program([*map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert len(err.splitlines()) == 1
    return err


@pytest.mark.parametrize(('program', 'name'), [(program, name) for program, names in RESULTS.items() for name in names])
def test_a_file_of_somebody_else_is_named_and_stays(arguments, tmp_path, capsys, program, name):
    (tmp_path / name).write_text('mine')
    said = refusal(capsys, program, *arguments[program], '--output', tmp_path)
    assert f'{tmp_path / name} exists and may be yours: move it, choose another folder, or ' in said
    assert 'replace it with --overwrite' in said
    assert os.listdir(tmp_path) == [name]
    assert (tmp_path / name).read_text() == 'mine'


@pytest.mark.parametrize('program', RESULTS)
def test_it_is_replaced_with_overwrite_and_afterwards_without(arguments, tmp_path, program):
    for name in (*RESULTS[program], 'notes', 'compare_7.mcap'):
        (tmp_path / name).write_text('mine')
    for overwrite in (['--overwrite'], []):
        assert program([*arguments[program], '--output', str(tmp_path), *overwrite]) == 0
        assert all((tmp_path / name).read_bytes() != b'mine' for name in RESULTS[program])
    assert (tmp_path / 'notes').read_text() == (tmp_path / 'compare_7.mcap').read_text() == 'mine'


def test_an_immutable_result_is_refused_and_nothing_is_left(arguments, results, tmp_path, capsys):
    folder = tmp_path / 'out'
    shutil.copytree(results, folder)
    report = folder / 'report.json'
    made = subprocess.run(['chattr', '+i', report], capture_output=True, check=False)
    if made.returncode:
        pytest.skip('files cannot be made immutable here')
    try:
        said = refusal(capsys, identify_bag, *arguments[identify_bag], '--output', folder)
    finally:
        subprocess.run(['chattr', '-i', report], check=True)
    assert f'{report} is a mount point, immutable or another user' in said
    assert os.listdir(tmp_path) == ['out']


@pytest.mark.parametrize('kind', ['pipe', 'link', 'link to nowhere', 'link to earlier results', 'folder'])
def test_what_is_no_file_is_nobody_s_result(arguments, results, tmp_path, capsys, kind):
    path = tmp_path / 'report.json'
    (tmp_path / 'mine').write_text('mine')
    if kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'folder':
        path.mkdir()
    else:
        targets = {'link': 'mine', 'link to nowhere': 'nowhere', 'link to earlier results': results / path.name}
        path.symlink_to(targets[kind])
    before = path.lstat().st_ino
    overwrite = ['--overwrite'] if kind == 'folder' else []
    message = 'is a folder and is not replaced' if kind == 'folder' else 'exists and may be yours'
    assert message in refusal(capsys, identify_bag, *arguments[identify_bag], '--output', tmp_path, *overwrite)
    assert path.lstat().st_ino == before
    assert (tmp_path / 'mine').read_text() == 'mine'


def test_results_that_this_run_does_not_write_stay_if_they_are_somebody_s_own(bag, tmp_path):
    (tmp_path / 'report.html').write_text('mine')
    (tmp_path / 'compare.mcap').write_text('mine')
    assert identify_bag([str(bag), '--output', str(tmp_path)]) == 0
    assert (tmp_path / 'report.html').read_text() == (tmp_path / 'compare.mcap').read_text() == 'mine'


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('report.json', '{\n  "schema": 1,\n  "recordings": [\n'),
        ('report.html', '<!DOCTYPE html>\n<head>\n<meta name="generator" content="cfd_pneumatic 0.2.0">\n'),
        ('parameters.yaml', '# identify_bag, run 0123456789abcdef\n/**:\n'),
    ],
)
def test_results_of_version_0_2_0_are_known(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    assert REPORT_FILES.is_earlier(tmp_path / name)


def test_a_recording_is_no_result_though_this_program_wrote_it(bag, results, tmp_path):
    assert REPORT_FILES.is_earlier(results / 'compare.mcap')
    os.link(bag / 'strokes.mcap', tmp_path / 'compare.mcap')
    assert not REPORT_FILES.is_earlier(tmp_path / 'compare.mcap')


def test_a_schedule_is_a_plan_s_beside_the_plan_alone(arguments, tmp_path):
    assert plan_experiment([*arguments[plan_experiment], '--output', str(tmp_path)]) == 0
    schedule = tmp_path / 'schedule.csv'
    assert PLAN_FILES.is_earlier(schedule)
    by_hand = '\n'.join([','.join(SCHEDULE_COLUMNS), '0,0,0,3e4,3e4', '1,0.001,0,3e4,3e4\n'])
    planned = schedule.read_text()
    schedule.write_text(by_hand)
    assert not PLAN_FILES.is_earlier(schedule)
    schedule.write_text(planned)
    (tmp_path / 'plan.json').unlink()
    assert not PLAN_FILES.is_earlier(schedule)


def test_a_schedule_is_a_preview_s_beside_the_preview_alone(arguments, tmp_path, capsys):
    planned, previewed = tmp_path / 'planned', tmp_path / 'previewed'
    assert plan_experiment([*arguments[plan_experiment], '--output', str(planned)]) == 0
    assert force_on_path([*arguments[force_on_path], '--output', str(previewed)]) == 0
    assert PREVIEW_FILES.is_earlier(previewed / 'schedule.csv')
    said = refusal(capsys, force_on_path, *arguments[force_on_path], '--output', planned)
    assert f'{planned / "schedule.csv"} exists and may be yours' in said
    said = refusal(capsys, plan_experiment, *arguments[plan_experiment], '--output', previewed)
    assert f'{previewed / "schedule.csv"} exists and may be yours' in said


def test_a_draft_is_not_replaced_for_it_is_there_to_be_edited(bag, tmp_path, capsys):
    draft = tmp_path / 'scored_bore.py'
    draft.write_text('mine')
    options = bag, '--close-loop', '--output', tmp_path / 'out', '--draft-effect'
    assert f'{draft} exists and may be yours' in refusal(capsys, identify_bag, *options, draft)
    file = draft / 'scored_bore.py'
    assert f'cannot write {draft}: Not a directory' in refusal(capsys, identify_bag, *options, file)
    assert draft.read_text() == 'mine'
    assert os.listdir(tmp_path) == ['scored_bore.py']


def test_a_draft_that_came_while_the_run_worked_is_not_replaced(bag, tmp_path, capsys, monkeypatch):
    draft = tmp_path / 'scored_bore.py'

    def drawn(*_):
        draft.write_text('mine')
        return 'drawn'

    monkeypatch.setattr('cfd_pneumatic.reporting.draft_effect', drawn)
    options = bag, '--close-loop', '--progress', 'none', '--output', tmp_path / 'out', '--draft-effect', draft
    assert identify_bag([*map(str, options)]) == 2
    assert f'{draft} exists and may be yours' in capsys.readouterr().err
    assert draft.read_text() == 'mine'


@pytest.mark.parametrize('name', ['index.html', 'results.csv', 'results.parquet', 'row.json', 'report.json'])
def test_the_files_of_a_plant_are_known(bag, tmp_path, capsys, name):
    pytest.importorskip('distributed')
    options = bag, '--each', '--jobs', '1', '--progress', 'none', '--output', tmp_path
    place = tmp_path / bag.parent.name / bag.name / name if name in ('row.json', 'report.json') else tmp_path / name
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text('mine')
    assert f'{place} exists and may be yours' in refusal(capsys, identify_bag, *options)
    assert place.read_text() == 'mine'
    assert [path for path in tmp_path.rglob('*') if path.is_file()] == [place]


def test_a_plant_replaces_its_own_files(bag, tmp_path, capsys):
    pytest.importorskip('distributed')
    options = [str(bag), '--each', '--jobs', '1', '--progress', 'none', '--output', str(tmp_path)]
    (tmp_path / 'index.html').write_text('mine')
    for overwrite in (['--overwrite'], []):
        os.utime(next(bag.glob('*.mcap')))  # it is another one now
        assert identify_bag([*options, *overwrite]) == 0
        assert capsys.readouterr().out.startswith('1 bag of 1 device, 0 failed\n')
    assert 'cfd_pneumatic' in (tmp_path / 'index.html').read_text()


@pytest.mark.parametrize('name', ['dask.pem', 'dask.key'])
def test_no_key_or_certificate_is_replaced_unasked(tmp_path, capsys, name):
    pytest.importorskip('distributed')
    (tmp_path / name).write_text('mine')
    assert f'{tmp_path / name} exists and may be yours' in refusal(capsys, dask_certificate, tmp_path)
    assert os.listdir(tmp_path) == [name]


def test_a_bag_that_is_there_is_refused_before_the_work(bag, tmp_path, capsys):
    assert 'exists already' in refusal(capsys, record_rig, 'no schedule of that name', '--output', bag)
    with BagWriter(tmp_path / 'bag'):
        said = refusal(capsys, record_rig, 'out_and_back', '--output', tmp_path / 'bag')
    assert 'is being written by another run' in said
