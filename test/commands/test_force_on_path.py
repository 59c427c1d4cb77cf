# SPDX-License-Identifier: Apache-2.0
"""`force_on_path` as people call it: its files, its units, and what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from known_device import AREA, KNOWN, identified_folder, surface

from cfd_pneumatic.commands.force_on_path import main
from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.rig import device_named, record, written_schedule

ROOT = Path(__file__).parents[2]
PAGE = ROOT / 'docs' / 'how_to' / 'predict_and_hold_the_force.md'
FILES = {'report.html', 'preview.json', 'preview.mcap', 'schedule.csv'}
POUND = 4.4482216152605  # [N], the pound-force by definition


@pytest.fixture(scope='module')
def place(tmp_path_factory):
    """Return a folder with a surface, a motion, an identified device and a parameter file."""
    folder = tmp_path_factory.mktemp('force')
    along, error = 1e3 * surface().along, 1e3 * surface().error
    rows = '\n'.join(f'{x!r},{y!r}' for x, y in zip(along.tolist(), error.tolist()))
    (folder / 'surface.csv').write_text(f'along_mm,error_mm\n{rows}\n')
    (folder / 'motion.csv').write_text('time_s,displacement_mm\n0,0\n0.5,0.4\n1,0\n')
    KNOWN.save(folder / 'known.yaml')
    identified_folder(str(folder / 'device'))
    return folder


@pytest.fixture(scope='module')
def held(place):
    """Return the folder of a preview of the identified device, with held set-points."""
    assert main([*arguments(place), '--tolerance', '10%', '--hold', '--output', str(place / 'held')]) == 0
    return place / 'held'


def arguments(place, path='surface.csv', device='device', force='20N', feed='50mm/s'):
    given = [str(place / path), '--device', str(place / device), '--force', force]
    return given if feed is None else [*given, '--feed', feed]


def answers(place, folder, *options, **changed):
    """Run the program and return the content of `preview.json`."""
    assert main([*arguments(place, **changed), *options, '--output', str(folder)]) == 0
    return json.loads((folder / 'preview.json').read_text())


def refusal(capsys, place, folder, *options, **changed):
    """Return the one line with which the program refuses, after which nothing is written."""
    capsys.readouterr()
    assert main([*arguments(place, **changed), *options, '--output', str(folder)]) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert len(err.splitlines()) == 1
    assert err.startswith('force_on_path: error: ')
    assert not folder.exists()
    return err


def test_a_preview_has_its_files(held):
    assert {path.name for path in held.iterdir()} == FILES
    head, *rows = (held / 'schedule.csv').read_text().splitlines()
    assert tuple(head.split(',')) == SCHEDULE_COLUMNS
    assert float(rows[-1].split(',')[0]) == pytest.approx(0.2 / 0.05 + 1.0)
    text = (held / 'report.html').read_text(encoding='utf-8')
    for answer in json.loads((held / 'preview.json').read_text())['answers']:
        assert f'>{answer}</th>' in text


def test_the_answers_are_printed(place, capsys, tmp_path):
    preview = answers(place, tmp_path / 'out', '--tolerance', '2N')
    out = ' '.join(capsys.readouterr().out.split())
    for question, answer in preview['answers'].items():
        assert f'{question} {answer}' in out
    assert ' / '.join(preview['answers']) == 'Path / Set-points / Force error / Tolerance / Fastest feed / Causes / Air'
    assert preview['notes'] == []
    assert preview['held'] is None


def test_the_rig_gives_the_predicted_force(held):
    """The device `paper` of the rig, which was identified, and not its model, plays the schedule."""
    preview = json.loads((held / 'preview.json').read_text())
    played = record(written_schedule(held / 'schedule.csv'), device_named('paper'), seed=11)
    force = np.interp(np.array(preview['time_s']) + 0.5, played.times, played.truth.force)
    settled = np.array(preview['time_s']) > 0.1  # the path begins with a leap of the speed
    predicted, wanted = (np.asarray(preview[part]['force_n']) for part in ('held', 'constant'))
    assert np.sqrt(np.mean((force - predicted)[settled] ** 2)) < 0.1
    assert np.sqrt(np.mean((force - 20.0)[settled] ** 2)) < 0.2 * np.sqrt(np.mean((wanted - 20.0)[settled] ** 2))


def test_the_schedule_and_the_bag_are_for_other_programs(held, tmp_path):
    assert record_rig([str(held / 'schedule.csv'), '--device', 'paper', '--output', str(tmp_path / 'bag')]) == 0
    previewed = read_recording(held / 'preview.mcap', namespace='/held')
    played = read_recording(tmp_path / 'bag')
    for name in ('cylinder_a', 'cylinder_b'):
        setpoints = [recording.cylinders[name].setpoint for recording in (previewed, played)]
        assert np.max(setpoints[0].values) == pytest.approx(np.max(setpoints[1].values), abs=1.0)


@pytest.mark.parametrize(
    ('option', 'given', 'key', 'expected'),
    [
        ('feed', '50mm/s', 'feed_m_per_s', 0.05),
        ('feed', '0.05', 'feed_m_per_s', 0.05),
        ('feed', '5cm/s', 'feed_m_per_s', 0.05),
        ('force', '4lbf', 'force_n', 4.0 * POUND),
        ('force', '0.02kN', 'force_n', 20.0),
        ('force', '-20N', 'force_n', -20.0),
        ('force', '-2e1', 'force_n', -20.0),
    ],
)
def test_numbers_have_units(place, tmp_path, option, given, key, expected):
    preview = answers(place, tmp_path / 'out', device='known.yaml', **{option: given})
    assert preview[key] == pytest.approx(expected)


@pytest.mark.parametrize(('given', 'expected'), [('10%', 2.0), ('1.5N', 1.5), ('1.5', 1.5)])
def test_a_tolerance_is_a_force_or_a_share_of_the_force(place, tmp_path, given, expected):
    preview = answers(place, tmp_path / 'out', '--tolerance', given, device='known.yaml')
    assert preview['tolerance_n'] == pytest.approx(expected)


def test_the_limits_of_the_regulators_have_units(place, tmp_path):
    options = ('--hold', '--range', '0.3bar', '0.8bar', '--rate', '25', '--slew', '5bar/s', '--bias', '55kPa')
    answers(place, tmp_path / 'out', *options, device='known.yaml')
    levels = np.loadtxt(tmp_path / 'out' / 'schedule.csv', delimiter=',', skiprows=1)[:, 3:]
    assert np.all((levels >= 0.3e5 - 1.0) & (levels <= 0.8e5 + 1.0))
    changes = np.flatnonzero(np.any(np.diff(levels, axis=0) != 0.0, axis=1))
    assert np.min(np.diff(changes)) >= 19  # 40 ms between set-points, in samples of 2 ms, less rounding
    assert np.max(np.abs(np.diff(levels, axis=0))) <= 5e5 / 25 + 1.0
    assert np.mean(levels) == pytest.approx(55e3, rel=0.05)


def test_a_parameter_file_has_a_note_on_the_band(place, tmp_path, capsys):
    preview = answers(place, tmp_path / 'out', device='known.yaml')
    assert 'The uncertainty of the device is not known' in preview['notes'][0]
    assert 'note: The uncertainty of the device is not known' in ' '.join(capsys.readouterr().out.split())
    assert np.max(preview['constant']['half_band_n']) == 0.0


@pytest.mark.parametrize(('option', 'cause'), [('--scan-error', 'scan'), ('--timing-error', 'timing')])
def test_errors_of_the_plan_are_in_the_band(place, tmp_path, option, cause):
    size = '0.05mm' if cause == 'scan' else '5ms'
    constant = answers(place, tmp_path / 'out', option, size, device='known.yaml')['constant']
    assert constant['standard_error_n'][cause] > 0.01
    assert constant['standard_error_n'].keys() == {'parameters', 'model', cause}


def test_a_motion_over_time_needs_no_feed(place, tmp_path):
    preview = answers(place, tmp_path / 'out', path='motion.csv', device='known.yaml', feed=None)
    assert (preview['feed_m_per_s'], preview['duration_s'], preview['along_m']) == (None, 1.0, None)


def test_the_page_on_the_files_lists_the_keys_of_the_preview(held):
    section = PAGE.read_text(encoding='utf-8').partition('## What the files contain')[2].partition('\n## ')[0]
    listed = [
        set(re.findall(r'`(\w+)`', ' '.join(re.findall(r'^\|([^|]*)\|', table, re.MULTILINE))))
        for table in section.split('Each prediction has:')
    ]
    preview = json.loads((held / 'preview.json').read_text())
    assert listed == [set(preview), set(preview['held'])]


# what is refused


def test_a_missing_device_is_refused(place, tmp_path, capsys):
    assert 'nowhere' in refusal(capsys, place, tmp_path / 'out', device='nowhere')


def test_a_folder_without_parameters_is_refused(place, tmp_path, capsys):
    (place / 'empty').mkdir()
    said = refusal(capsys, place, tmp_path / 'out', device='empty')
    assert 'has no parameters.yaml: give the output folder of identify_bag' in said


@pytest.mark.parametrize(
    ('changed', 'options', 'message'),
    [
        ({'feed': '0'}, (), 'the feed must be a positive speed, is 0 m/s'),
        ({'feed': None}, (), 'needs a feed in m/s. Add --feed'),
        ({'feed': '5'}, ('--tolerance', '-1N'), 'the tolerance must be above 0'),
        ({'feed': '50mm'}, (), "argument --feed: '50mm' is not a number, or not in one of the units m/s, cm/s, mm/s"),
        ({'force': '20kg'}, (), "argument --force: '20kg' is not a number, or not in one of the units N, "),
        ({'force': '0'}, (), 'the wanted force must be a finite number other than 0'),
        ({'force': '2kN'}, (), 'but the regulators reach'),
        ({}, ('--tolerance', 'ten'), "'ten' is not a number"),
        ({}, ('--tolerance', 'ten%'), "'ten' is not a finite number"),
        ({}, ('--hold', '--rate', '0'), 'the rate of set-points must be above 0'),
        ({}, ('--range', '1bar', '0'), 'must have the lower set-point first'),
        ({}, ('--scan-error', '-1mm'), 'the scan error must be 0 or above'),
        ({'path': 'motion.csv'}, (), 'a feed is for a surface, but the path is given over time. Leave the feed out'),
        ({'path': 'nowhere.csv'}, (), 'nowhere.csv'),
    ],
    ids=str,
)
def test_bad_input_is_one_line(place, tmp_path, capsys, changed, options, message):
    assert message in refusal(capsys, place, tmp_path / 'out', *options, **{'device': 'known.yaml', **changed})


def test_a_path_outside_of_the_stroke_is_refused(place, tmp_path, capsys):
    (place / 'steep.csv').write_text('along_mm,error_mm\n0,0\n200,40\n')
    said = refusal(capsys, place, tmp_path / 'out', path='steep.csv')
    assert re.search(
        r'the path needs displacements of -?\d+\.?\d* to \d+\.?\d* mm, but the device was identified', said
    )
    assert 'Teach a path that is closer to the surface' in said


def test_a_device_without_an_area_is_refused(place, tmp_path, capsys):
    lines = (place / 'known.yaml').read_text().splitlines()
    (place / 'no_area.yaml').write_text('\n'.join(line for line in lines if f'area: {AREA}' not in line))
    assert 'the area of the pistons is not known' in refusal(capsys, place, tmp_path / 'out', device='no_area.yaml')


def test_one_cylinder_with_a_force_of_the_wrong_sign_is_refused(place, tmp_path, capsys):
    KNOWN.with_values({'cylinder_b.enabled': False}).save(place / 'single.yaml')
    said = refusal(capsys, place, tmp_path / 'out', device='single.yaml', force='-20N')
    assert '--force -20 N: the device has only cylinder_a, which gives forces of the opposite sign' in said


@pytest.mark.parametrize('name', sorted(FILES))
def test_a_foreign_file_in_the_output_folder_stays(place, tmp_path, capsys, name):
    (tmp_path / name).write_text('mine')
    capsys.readouterr()
    assert main([*arguments(place, device='known.yaml'), '--output', str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert f'{tmp_path / name} exists and may be yours' in err
    assert (tmp_path / name).read_text() == 'mine'
