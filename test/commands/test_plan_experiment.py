# SPDX-License-Identifier: Apache-2.0
"""`plan_experiment` as people call it, and what comes after it: the rig plays, `identify_bag` identifies."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.commands.plan_experiment import main
from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.convention import SCHEDULE_COLUMNS

TABLE_1 = Path(__file__).parents[2] / 'config' / 'table_1.yaml'
QUICK = ('--duration', '6', '--pressures', '40e3', '60e3')
FILES = {'plan.html', 'plan.json', 'schedule.csv', 'schedule.svg'}


@pytest.fixture(scope='module')
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp('plans') / 'planned'
    assert main([str(TABLE_1), '--output', str(folder), *QUICK]) == 0
    return folder


def refusal(capsys, *arguments):
    """Return the one line with which the program refuses."""
    capsys.readouterr()
    assert main([*map(str, arguments)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith('plan_experiment: error: ')
    return lines[0]


def parameters(path, text):
    path.write_text(f'/**:\n  ros__parameters:\n{text}')
    return path


def test_a_plan_is_a_schedule_its_prediction_and_a_picture(planned, capsys):
    assert {path.name for path in planned.iterdir()} == FILES
    plan = json.loads((planned / 'plan.json').read_text())
    head, *rows = (planned / 'schedule.csv').read_text().splitlines()
    assert tuple(head.split(',')) == SCHEDULE_COLUMNS
    assert float(rows[-1].split(',')[0]) == plan['duration_s'] <= 6.0
    assert {one['channel'] for one in plan['effects']} == {'cylinder_a', 'cylinder_b', 'force'}
    assert (planned / 'schedule.svg').read_text().startswith('<svg')


def test_the_same_command_writes_the_same_files(planned, tmp_path):
    assert main([str(TABLE_1), '--output', str(tmp_path), *QUICK]) == 0
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (planned / name).read_bytes()


def test_what_is_planned_can_be_played_and_identified(planned, tmp_path, capsys):
    bag, found = tmp_path / 'bag', tmp_path / 'found'
    assert record_rig([str(planned / 'schedule.csv'), '--output', str(bag)]) == 0
    assert identify_bag([str(bag), '--output', str(found), '--progress', 'none']) == 0
    report = json.loads((found / 'report.json').read_text())
    for result in report['cylinders'].values():
        assert all(one['identifiable'] for one in result['parameters'].values())
    assert report['split']['no_test_part'] is None
    assert report['next_plan'] is None
    assert 'plan_experiment' not in capsys.readouterr().out


def test_the_advice_of_identify_bag_runs_as_it_stands(tmp_path, capsys, monkeypatch):
    """A step that only charges tells no discharging gain, and little else."""
    bag, found = tmp_path / 'bag', tmp_path / 'found here'
    assert record_rig(['paper_step', '--output', str(bag)]) == 0
    assert identify_bag([str(bag), '--output', str(found), '--close-loop', '--progress', 'none']) == 0
    lines = capsys.readouterr().out.splitlines()
    (command,) = (line.partition(': ')[2] for line in lines if line.startswith('To plan the next experiment: '))
    program, *arguments = shlex.split(command)
    assert program == 'plan_experiment'
    assert 'operating_point' in arguments
    assert main([*arguments, '--duration', '5']) == 0
    said = ' '.join(capsys.readouterr().out.split())  # as in the recording
    assert re.match(
        r'Stroke: 1[.]5\d mm, from .+/report[.]json[.] Sample rate: 500 Hz, from .+/report[.]json[.] ', said
    )
    assert {path.name for path in (found / 'next').iterdir()} >= FILES
    inside = json.loads((found / 'report.json').read_text())['next_plan']
    assert inside.replace('parameters.yaml', 'X') in command.replace(f"'{found}/parameters.yaml'", 'X').replace(
        f"'{found}/report.json'", 'report.json'
    ).replace(f"'{found}/next'", 'next')
    assert inside.split('--wanted')[1].split()[0] in (found / 'report.html').read_text()


def test_wanted_and_the_sensors_are_taken_over(tmp_path, capsys):
    noise = ['--pressure-noise', '200', '--sample-rate', '250', '--wanted', 'k_v', 'leakage']
    assert main([str(TABLE_1), '--output', str(tmp_path), *QUICK, *noise]) == 0
    plan = json.loads((tmp_path / 'plan.json').read_text())
    assert {one['name'] for one in plan['parameters']} <= {'k_v', 'area'}
    assert {one['effect'] for one in plan['effects']} == {'leakage'}
    times = np.loadtxt(tmp_path / 'schedule.csv', delimiter=',', skiprows=1, usecols=0)
    assert np.diff(times) == pytest.approx(0.004, abs=2e-9)
    assert capsys.readouterr().out.startswith('Stroke: 3 mm, the default. Sample rate: 250 Hz, from --sample-rate.\n')


def test_a_rate_at_which_effects_are_not_visible_gets_an_advice(tmp_path, capsys):
    options = ['--stroke', '2e-3', '--sample-rate', '250', '--wanted', 'leakage', 'sensor_lag', 'line_resonance']
    assert main([str(TABLE_1), '--output', str(tmp_path), *QUICK, *options]) == 0
    said = capsys.readouterr().out
    text = ' '.join(said.split())
    assert text.startswith('Stroke: 2 mm, from --stroke. Sample rate: 250 Hz, from --sample-rate.')
    assert (
        'A recording at 1,000 Hz shows sensor_lag and line_resonance better. '
        'To plan for 1,000 Hz, add `--sample-rate 1000`.'
    ) in text
    plan = json.loads((tmp_path / 'plan.json').read_text())
    rounds = plan['rounds']
    assert f'The schedule has {rounds} round' in text
    assert f' takes {plan["duration_s"]:.1f} s. ' in text
    for effect in plan['effects']:  # no name is cut off
        nearest = effect['most_alike']
        assert nearest is None or nearest in said
        assert all(name in said for name in effect['not_told_from'])


def test_what_the_file_lacks_is_said_to_be_table_1s(tmp_path, capsys):
    file = parameters(tmp_path / 'p.yaml', '    cylinder_a:\n      setpoints: [5.0e+4]\n      k_x: [5.0e+6]\n')
    assert main([str(file), '--output', str(tmp_path / 'out'), '--duration', '5']) == 0
    printed = capsys.readouterr().out
    assert 'cylinder_a.k_v is not in' in printed
    assert 'cylinder_a.k_x is not in' not in printed


def test_dotted_names_and_a_single_cylinder_are_read(tmp_path):
    file = tmp_path / 'p.yaml'
    entries = {'cylinder_a.setpoints': [5e4], 'cylinder_a.k_x': [5e6], 'cylinder_b.enabled': False}
    file.write_text(yaml.safe_dump({'/cfd/sim/sim_node': {'ros__parameters': entries}}))
    assert main([str(file), '--output', str(tmp_path / 'out'), '--duration', '5', '--wanted', 'k_x']) == 0
    plan = json.loads((tmp_path / 'out' / 'plan.json').read_text())
    values = {one['channel']: one['value'] for one in plan['parameters'] if one['name'] == 'k_x'}
    assert values == {'cylinder_a': 5e6}


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('    area: 1.0e-3\n', 'describes neither cylinder_a nor cylinder_b'),
        ('    cylinder_a:\n      setpoints: [2.0, 1.0]\n', 'strictly increasing'),
        ('    cylinder_a:\n      k_x: nothing\n', 'cylinder_a.k_x: give a list of numbers'),
        ('    cylinder_a:\n      k_x: [-1.0]\n      setpoints: [1.0]\n', 'cylinder_a.k_x[0] = -1 is outside'),
        ('    cylinder_a:\n      leakage: {enabled: 1}\n', 'cylinder_a.leakage.enabled: give true or false'),
        ('    cylinder_a:\n      leakage: {enabled: true, conductance: -1.0}\n', 'conductance = -1 is outside 0 to'),
        ('    cylinder_a: [\n', 'is not YAML'),
        (
            '    cylinder_a:\n      k_x: [4.0e+6]\n      k_x: [5.0e+6]\n',
            'line 5: the key is already in line 4: remove one of the two',
        ),
    ],
)
def test_a_bad_parameter_file_is_one_line(tmp_path, capsys, text, message):
    file = parameters(tmp_path / 'p.yaml', text)
    assert message in refusal(capsys, file, '--output', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--stroke', '0'], 'stroke 0 m'),
        (['--duration', '0.2'], 'is too short for a stroke'),
        (['--pressures', '6e4', '3e4'], 'give the lower first'),
        (['--wanted', 'leek'], 'leek is neither a parameter nor an effect'),
        (['--sample-rate', '1'], 'sample rate 1 Hz'),
        (['--duration', '3600', '--sample-rate', '5000'], 'more than 400,000 samples: give a shorter duration, or'),
        (['--report', 'none.json'], 'none.json cannot be read: No such file or directory'),
        (['--report', str(TABLE_1)], 'is not a report of identify_bag'),
    ],
)
def test_bad_limits_are_one_line_and_earlier_plans_stay(planned, capsys, arguments, message):
    earlier = {path.name: path.read_bytes() for path in planned.iterdir()}
    assert message in refusal(capsys, TABLE_1, '--output', planned, *arguments)
    assert {path.name: path.read_bytes() for path in planned.iterdir()} == earlier


@pytest.mark.parametrize(
    ('samples', 'duration'),
    [('1' * 400, 1), ('1e999', 1), ('[' * 100_000, 1), (5, 'NaN'), (5, '1e-320')],
    ids=['long', 'infinite', 'deep', 'no number', 'no time'],
)
def test_a_report_with_a_number_that_cannot_be_is_refused(tmp_path, capsys, samples, duration):
    text = f'{{"cylinders": {{"a": {{"noise_floor_pa": 1}}}}, "recordings": [{{"displacement_samples": {samples}, '
    (tmp_path / 'report.json').write_text(f'{text}"duration_s": {duration}, "travel_m": [0, 1]}}]}}')
    arguments = (TABLE_1, '--report', tmp_path / 'report.json', '--output', tmp_path / 'out')
    assert 'is not a report of identify_bag' in refusal(capsys, *arguments)


def test_a_missing_parameter_file_and_a_folder_that_cannot_be_made(tmp_path, capsys):
    assert 'cannot be read' in refusal(capsys, tmp_path / 'none.yaml', '--output', tmp_path / 'out')
    (tmp_path / 'file').write_text('')
    assert 'cannot write ' in refusal(capsys, TABLE_1, '--output', tmp_path / 'file', *QUICK)


def test_help_says_units_and_defaults():
    done = subprocess.run(
        [sys.executable, '-m', 'cfd_pneumatic.commands.plan_experiment', '--help'],
        capture_output=True,
        text=True,
        check=True,
    )
    assert '[m/s^2] (default: 10.0)' in ' '.join(done.stdout.split())
    assert 'example: plan_experiment' in ' '.join(done.stdout.split())
