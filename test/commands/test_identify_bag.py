# SPDX-License-Identifier: Apache-2.0
"""`identify_bag` as people call it: on bags, on bad ones, and on folders that can't be written."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys

import made
import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from cfd_pneumatic import convention
from cfd_pneumatic.commands.identify_bag import main
from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.files.staging import checksum
from cfd_pneumatic.identification import title
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.recording import BagWriter


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'strokes'
    assert record_rig(['out_and_back', '--output', str(path)]) == 0
    return path


EARLIER = {'report.json': '{"schema": 1, "recordings": []}', 'parameters.yaml': '# identify_bag, run earlier\n'}
"""What files of an earlier run begin with."""


@pytest.fixture
def output(tmp_path):
    """Return a folder with earlier results, which must outlive a failure."""
    folder = tmp_path / 'out'
    folder.mkdir()
    for name, content in EARLIER.items():
        (folder / name).write_text(content)
    return folder


def refusal(capsys, output, *arguments):
    """Return the one line with which identify_bag refuses; check that it fails as it should."""
    capsys.readouterr()
    assert main([*map(str, arguments), '--output', str(output)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith('identify_bag: error: ')
    assert {path.name: path.read_text() for path in output.iterdir()} == EARLIER
    return lines[0]


def device_bag(path, piston, pressure, stamps=None, storage='mcap'):
    """Write a bag of one cylinder, sampled at 500 Hz or at the stamps given [ns]."""
    stamps = 10**9 + 2_000_000 * np.arange(len(piston)) if stamps is None else stamps
    with BagWriter(path, storage=storage) as writer:
        writer.add_topic('/cfd/device/piston_state', convention.JOINT_STATE)
        writer.add_topic('/cfd/device/cylinder_a/pressure', convention.FLUID_PRESSURE)
        for stamp, position, value in zip(map(int, stamps), piston, pressure):
            made.write_message(writer, '/cfd/device/piston_state', stamp, made.joint_state(stamp, 'piston', position))
            made.write_message(writer, '/cfd/device/cylinder_a/pressure', stamp, made.fluid_pressure(stamp, value))
    return path


def test_a_bag_becomes_a_report_and_parameters(bag, tmp_path, capsys):
    output = tmp_path / 'new' / 'folder'
    assert main([str(bag), '--output', str(output)]) == 0
    printed = capsys.readouterr().out
    assert 'lbf/in^3' in printed
    assert 'report.json' in printed
    report = json.loads((output / 'report.json').read_text())
    assert set(report['cylinders']) == {'cylinder_a', 'cylinder_b'}
    parameters = yaml.safe_load((output / 'parameters.yaml').read_text())['/**']['ros__parameters']
    assert parameters['cylinder_b']['k_x'] == [report['cylinders']['cylinder_b']['parameters']['k_x']['value']]


def test_what_looks_like_a_mistake_is_said_before_anything_is_identified(tmp_path, capsys):
    table, mapping = tmp_path / 'press.csv', tmp_path / 'press.yaml'
    table.write_text('t,x,p\n' + ''.join(f'{0.002 * row},{row % 7},700\n' for row in range(400)))
    mapping.write_text(
        'table: {time: {column: t, unit: s}, delimiter: comma, header_rows: 1}\n'
        'displacement: {column: x, unit: m}\n'
        'cylinder_a: {pressure: {column: p, unit: bar, reference: gauge}}\n'
    )
    assert main([str(table), '--mapping', str(mapping), '--output', str(tmp_path / 'out'), '--progress', 'none']) == 2
    printed = capsys.readouterr().out
    assert 'warning: the piston moves 6 m: check the unit of the displacement' in printed
    assert 'Ctrl-C' in printed


def test_a_name_is_no_markup(bag, tmp_path, capsys):
    odd = tmp_path / '[bold]press[7]:smile:'
    shutil.copytree(bag, odd)
    assert main([str(odd), '--output', str(tmp_path / 'out'), '--progress', 'none']) == 0
    assert f'{odd.name}:' in capsys.readouterr().out


def test_the_same_bag_gives_the_same_files(bag, tmp_path):
    for name in ('one', 'two'):
        assert main([str(bag), '--output', str(tmp_path / name), '--progress', 'none']) == 0
    for name in ('report.json', 'parameters.yaml'):
        assert (tmp_path / 'one' / name).read_bytes() == (tmp_path / 'two' / name).read_bytes()


def test_closing_the_loop_writes_a_page_and_a_comparison_and_says_the_verdicts(bag, tmp_path, capsys):
    assert main([str(bag), '--close-loop', '--output', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    report = json.loads((tmp_path / 'report.json').read_text())
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {'report.json', 'parameters.yaml', 'report.html', 'compare.mcap'}
    assert all(str(tmp_path / name) in printed for name in names)
    assert all('verdict' in block for block in report['cylinders'].values())
    page = (tmp_path / 'report.html').read_text()
    words = {
        'effect_added': 'Effect found',
        'no_missing_effect': 'Nothing missing',
        'unexplained': 'Unexplained',
        'insufficient_data': 'Not enough data',
    }
    for cylinder, block in report['cylinders'].items():
        beside = ', with a hypothesis' if block['status'] == 'hypothesis' else ''
        assert f'{title(cylinder)}: {words[block["verdict"]]}{beside}.' in printed
        assert words[block['verdict']] in page
        for effect in block['effects']:
            assert effect.replace('_', ' ') in printed
    assert printed.strip().splitlines()[-1] == f'report: {tmp_path / "report.html"}'
    assert 'strokes' in page


def test_operating_points_of_a_bag_with_two_set_points(bag, tmp_path):
    assert main([str(bag), '--per-setpoint', '--output', str(tmp_path)]) == 0
    report = json.loads((tmp_path / 'report.json').read_text())
    setpoints = [point['setpoint_pa'] for point in report['cylinders']['cylinder_a']['schedule']]
    np.testing.assert_allclose(setpoints, [34_473.8, 68_947.6], rtol=0.01)


def printed_gains(text, cylinder):
    """Return for each table of a cylinder's gains its title, and value and standard error of each gain as printed."""
    titles = rf'^({cylinder} at [^\n]*?) *$(.*?)(?=^cylinder_)'
    rows = r'│ (k_x|k_sv|k_v|tau) +│ +(not identifiable|[^ │]+) +│ +([^ │]*) *│'
    return [
        (title, {name: (value, std) for name, value, std in re.findall(rows, table)})
        for title, table in re.findall(titles, text, re.MULTILINE | re.DOTALL)
    ]


def as_printed(estimates):
    """Return values and standard errors of a report as the console shows them."""
    return {
        name: (f'{one["value"]:.4g}', f'{one["std"]:.2g}') if one['identifiable'] else ('not identifiable', '')
        for name, one in estimates.items()
    }


def test_console_report_and_file_give_the_gains_of_the_model_that_is_reported(tmp_path, capsys):
    """Of B beside its effect, the same at every set-point; of A, which has none, at each set-point."""
    faults = ['--device', 'paper', '--faults', 'effects_b.dead_band=300']
    assert record_rig(['out_and_back', *faults, '--output', str(tmp_path / 'bag')]) == 0
    capsys.readouterr()
    assert (
        main([str(tmp_path / 'bag'), '--close-loop', '--per-setpoint', '--verbose', '--output', str(tmp_path / 'out')])
        == 0
    )
    printed = capsys.readouterr().out
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())['cylinders']
    written = yaml.safe_load((tmp_path / 'out' / 'parameters.yaml').read_text())['/**']['ros__parameters']

    block = report['cylinder_b']
    assert block['effects'] == ['valve_dead_band']
    assert block['parameters_after']['k_v']['value'] != block['parameters']['k_v']['value']
    ((title, gains),) = printed_gains(printed, 'cylinder_b')
    assert title == 'cylinder_b at every set-point, with valve_dead_band'
    assert gains == as_printed(block['parameters_after'])
    assert 'cylinder_b: simulated against measured pressure, without effects' in printed
    for name in NAMES:
        assert written['cylinder_b'][name] == [block['parameters_after'][name]['value']]
    assert written['cylinder_b']['valve_dead_band']['enabled'] is True
    page = (tmp_path / 'out' / 'report.html').read_text()
    assert page.count('<code>parameters.yaml</code> holds the estimates with effects') == 1
    assert page.count('<code>parameters.yaml</code> holds a fit to each') == 1

    block = report['cylinder_a']
    assert block['effects'] == []
    tables = printed_gains(printed, 'cylinder_a')
    assert [re.search(r'at (\S+) kPa', title)[1] for title, _ in tables] == ['34.5', '68.9']
    assert [gains for _, gains in tables] == [as_printed(point['parameters']) for point in block['schedule']]
    for name in NAMES:
        assert written['cylinder_a'][name] == [point['parameters'][name]['value'] for point in block['schedule']]


def test_a_gain_that_is_not_identifiable_is_so_everywhere(tmp_path, capsys):
    assert record_rig(['paper_step', '--device', 'paper', '--output', str(tmp_path / 'bag')]) == 0
    capsys.readouterr()
    assert main([str(tmp_path / 'bag'), '--output', str(tmp_path / 'out')]) == 0
    printed = capsys.readouterr().out
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())['cylinders']
    text = (tmp_path / 'out' / 'parameters.yaml').read_text()
    written = yaml.safe_load(text)['/**']['ros__parameters']
    for cylinder, untold in ('cylinder_a', []), ('cylinder_b', ['k_sv']):
        estimates = report[cylinder]['parameters']
        assert [name for name in NAMES if not estimates[name]['identifiable']] == untold
        ((_, gains),) = printed_gains(printed, cylinder)
        assert gains == as_printed(estimates)
        told = {name: [estimates[name]['value']] for name in NAMES if name not in untold}
        assert {name: written[cylinder][name] for name in told} == told
        assert written[cylinder].get('not_identifiable', []) == untold
    assert re.search(r'k_sv: \[\S+\]  # 1/s; not identifiable, value assumed in the fit: ', text)


def test_a_part_of_each_recording_may_be_identified(bag, tmp_path, capsys):
    assert main([str(bag), '--output', str(tmp_path), '--from', '1', '--until', '4.5', '--progress', 'none']) == 0
    (recording,) = json.loads((tmp_path / 'report.json').read_text())['recordings']
    assert recording['duration_s'] == pytest.approx(3.5, abs=0.01)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--from', '1e6'], 'is not within its'),
        (['--until', '1e6'], 'is not within its'),
        (['--from', '-1'], 'is not within its'),
        (['--from', '3', '--until', '2'], '3 to 2 s is not within its'),
        (['--from', 'nan'], "--from: 'nan' is not a finite number"),
        (['--from', '1', '--each'], 'Omit --each'),
    ],
)
def test_a_part_that_there_is_not_is_refused(bag, tmp_path, capsys, options, message):
    assert main([str(bag), '--output', str(tmp_path / 'out'), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_progress_as_lines_for_programs(bag, tmp_path, capsys):
    assert main([str(bag), '--output', str(tmp_path), '--progress', 'lines']) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    shares = [line['progress'] for line in lines]
    assert lines[-1]['verdicts'] == {}
    assert lines[-1]['report_sha256'] == checksum(tmp_path / 'report.json')
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_missing_bag(capsys, output, tmp_path):
    assert 'nowhere' in refusal(capsys, output, tmp_path / 'nowhere.mcap')


@pytest.mark.parametrize(
    ('argument', 'words'),
    [
        ('--area=0', 'area 0 m^2 is outside 1e-06 to 1 m^2'),
        ('--area=nan', "--area: 'nan' is not a finite number"),
        ('--area=1140', 'area 1140 m^2 is outside'),
        ('--geometric-factor=0', 'geometric_factor 0 is 0 or outside -1000 to 1000'),
        ('--geometric-factor=nan', "'nan' is not a finite number"),
        ('--geometric-factor=-2e3', 'geometric_factor -2000 is'),
    ],
)
def test_a_geometry_that_is_none(bag, capsys, output, argument, words):
    assert words in refusal(capsys, output, bag, argument)


def test_an_empty_bag(capsys, output, tmp_path):
    with BagWriter(tmp_path / 'empty') as writer:
        writer.add_topic('/cfd/device/piston_state', convention.JOINT_STATE)
    assert 'no messages' in refusal(capsys, output, tmp_path / 'empty')


def test_a_bag_of_something_else_lists_its_topics(capsys, output, tmp_path):
    with BagWriter(tmp_path / 'other') as writer:
        writer.add_topic('/temperature', convention.FLOAT64)
        made.write_message(writer, '/temperature', 1, made.float64(20.0))
    message = refusal(capsys, output, tmp_path / 'other')
    assert '/temperature' in message
    assert 'cylinder_a/pressure' in message


def test_an_unknown_message_type(capsys, output, tmp_path):
    types = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / 'odd', version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/cfd/device/piston_state', 'std_msgs/msg/Float64', typestore=types)
        writer.write(connection, 1, types.serialize_cdr(made.float64(1.0), 'std_msgs/msg/Float64'))
        pressure = writer.add_connection('/cfd/device/cylinder_a/pressure', 'std_msgs/msg/Float64', typestore=types)
        writer.write(pressure, 1, types.serialize_cdr(made.float64(1.0), 'std_msgs/msg/Float64'))
    assert 'std_msgs/msg/Float64' in refusal(capsys, output, tmp_path / 'odd')


def test_a_bag_without_motion(capsys, output, tmp_path):
    rng = np.random.default_rng(0)
    path = device_bag(tmp_path / 'still', 1e-6 * rng.normal(size=500), 2e5 + 50.0 * rng.normal(size=500))
    assert 'does not move' in refusal(capsys, output, path)


def test_a_bag_of_nan(capsys, output, tmp_path):
    path = device_bag(tmp_path / 'nan', np.full(100, np.nan), np.full(100, 2e5))
    assert 'finite' in refusal(capsys, output, path)


def test_a_clock_set_back(capsys, output, tmp_path):
    stamps = 10**13 + 2_000_000 * np.arange(400)
    stamps[200:] -= 3600 * 10**9
    path = device_bag(tmp_path / 'back', np.linspace(0.0, 1e-3, 400), np.full(400, 2e5), stamps)
    assert 'back' in refusal(capsys, output, path)


def test_a_stuck_pressure_sensor(capsys, output, tmp_path):
    times = 0.002 * np.arange(2000)
    path = device_bag(tmp_path / 'stuck', 1e-3 * np.sin(5.0 * times), np.full(2000, 2e5))
    assert 'cylinder_a/pressure never changes' in refusal(capsys, output, path)


@pytest.mark.parametrize('seed', range(5))
def test_a_pressure_that_does_not_follow_the_piston(capsys, output, tmp_path, seed):
    """Noise is no answer of a cylinder; no number may come out of it."""
    times = 0.002 * np.arange(2000)
    noise = 50.0 * np.random.default_rng(seed).normal(size=2000)
    path = device_bag(tmp_path / 'deaf', 1e-3 * np.sin(5.0 * times), 2e5 + noise)
    assert 'determine no parameter' in refusal(capsys, output, path)


def test_a_cut_off_mcap_is_salvaged_and_said_so(tmp_path, capsys):
    """The part before the cut, up to the last whole chunk of a megabyte, is identified."""
    assert record_rig(['surface_following', '--duration', '20', '--output', str(tmp_path / 'long')]) == 0
    whole = next((tmp_path / 'long').glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: int(0.9 * len(whole))])
    capsys.readouterr()
    assert main([str(cut), '--output', str(tmp_path / 'out')]) == 0
    assert 'cut off' in capsys.readouterr().out


@pytest.mark.parametrize('text', ['60/40', 'a/b/c', '60/20/0', 'nan/nan/nan', 'inf/1/1', '1e308/1e308/1', '-0/1/1'])
def test_a_split_that_is_none(bag, capsys, output, text):
    assert 'argument --split: ' in refusal(capsys, output, bag, '--split', text)


@pytest.mark.parametrize(
    'arguments', [['--area', 'nan'], ['--jobs', 'many'], ['--nothing'], ['--tolerance', '1e400Pa']]
)
def test_an_option_that_is_wrong_is_one_line(bag, capsys, output, arguments):
    assert arguments[0].strip('-') in refusal(capsys, output, bag, *arguments)


def test_a_long_argument_is_not_repeated_at_length(bag, capsys, output):
    assert len(refusal(capsys, output, bag, '--jobs', 'x' * 100_000)) < 500


def test_a_mapping_with_an_unknown_unit(bag, capsys, output, tmp_path):
    mapping = tmp_path / 'mapping.yaml'
    mapping.write_text('displacement: {topic: piston_state, field: "position[0]", unit: furlong}\n')
    message = refusal(capsys, output, bag, '--mapping', mapping)
    assert 'line 1: displacement: unit must be a unit of length' in message
    assert 'inch' in message
    assert 'furlong' not in message, 'no file but a table is quoted'


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--draft-effect', 'scored_bore.py'], 'Add --close-loop, and omit --each'),
        (['--close-loop', '--each', '--draft-effect', 'scored_bore.py'], 'Add --close-loop, and omit --each'),
        (['--close-loop', '--draft-effect', 'leakage.py'], 'the file must be named after a new effect'),
        (['--close-loop', '--draft-effect', 'scored bore.py'], 'the file must be named after a new effect'),
        (['--close-loop', '--draft-effect', 'scored_bore.txt'], 'the file must be named after a new effect'),
    ],
)
def test_a_draft_that_could_not_come_about_is_refused_before_any_work(bag, output, capsys, arguments, message):
    assert message in refusal(capsys, output, bag, *arguments)


@pytest.mark.parametrize(('option', 'value'), [('--jobs', '2'), ('--scheduler', 'tcp://localhost:8786')])
def test_options_for_many_bags_without_each(bag, capsys, output, option, value):
    assert '--each' in refusal(capsys, output, bag, option, value)


@pytest.mark.parametrize('more', [['--jobs', '0'], ['--jobs', '2', '--scheduler', 'tcp://localhost:8786']])
def test_jobs_that_are_none(bag, capsys, output, more):
    pytest.importorskip('distributed')
    assert '--jobs' in refusal(capsys, output, bag, '--each', *more)


def test_a_folder_without_bags(capsys, output, tmp_path):
    pytest.importorskip('distributed')
    (tmp_path / 'empty').mkdir()
    assert 'no bags in there' in refusal(capsys, output, tmp_path / 'empty', '--each')


@pytest.mark.parametrize('module', ['distributed', 'pyarrow'])
def test_each_without_what_it_needs(bag, output, module):
    """The module is hidden from a program of its own."""
    hide = f'import sys; sys.modules[{module!r}] = None; '
    call = 'from cfd_pneumatic.commands.identify_bag import main; sys.exit(main())'
    command = [sys.executable, '-c', hide + call, str(bag), '--each', '--output', str(output)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.startswith('identify_bag: error: --each needs Dask')
    assert "pip install 'cfd_pneumatic[plant]'" in run.stderr
    assert len(run.stderr.splitlines()) == 1


def test_a_folder_that_cannot_be_made(bag, capsys, tmp_path):
    (tmp_path / 'file').write_text('in the way')
    assert main([str(bag), '--output', str(tmp_path / 'file' / 'out')]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert 'choose a folder' in lines[0]


@pytest.mark.parametrize('linked', [True, False])
def test_results_go_where_a_link_leads_and_into_the_folder_where_one_is(bag, tmp_path, monkeypatch, linked):
    (tmp_path / 'real').mkdir()
    (tmp_path / 'link').symlink_to('real')
    monkeypatch.chdir(tmp_path if linked else tmp_path / 'real')
    for _ in range(2):
        assert main([str(bag), '--output', 'link' if linked else '.']) == 0
        assert sorted(os.listdir('link' if linked else '.')) == ['parameters.yaml', 'report.json']
    assert (tmp_path / 'link').is_symlink()


def test_the_program_itself_ends_with_code_2_and_no_traceback(tmp_path):
    run = subprocess.run(
        [sys.executable, '-m', 'cfd_pneumatic.commands.identify_bag', 'nowhere', '--output', str(tmp_path / 'out')],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2
    assert run.stdout == ''
    assert len(run.stderr.strip().splitlines()) == 1
    assert 'Traceback' not in run.stderr


def test_what_is_refused_leaves_no_folder_behind(tmp_path, capsys):
    output = tmp_path / 'results' / 'of_monday'
    assert main([str(tmp_path / 'none.mcap'), '--output', str(output)]) == 2
    assert 'does not exist' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
