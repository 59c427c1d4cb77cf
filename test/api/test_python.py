# SPDX-License-Identifier: Apache-2.0
"""The Python front door: the lines of its page, on the rig and on a measured run, and the notebook."""

from __future__ import annotations

import inspect
import pydoc
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import nbformat
import numpy as np
import pytest
from measured import MAPPING, ROOT, needs_measured_data

import cfd_pneumatic as cfd
from cfd_pneumatic import reporting
from cfd_pneumatic.commands.record_rig import main as record_rig
from studies.documents.notebook import NOTEBOOK, executed, notebook

mpl.use('Agg')

TABLE_1 = Path(__file__).parents[2] / 'config' / 'table_1.yaml'


@pytest.fixture(scope='module')
def rig(tmp_path_factory):
    bag = tmp_path_factory.mktemp('bags') / 'cell_7'
    faults = 'effects_a.leak_conductance=1e-10'
    assert record_rig(['out_and_back', '--device', 'paper', '--faults', faults, '--output', str(bag)]) == 0
    return bag


def test_what_a_notebook_shows_is_short_and_plain(rig):
    recording = cfd.read_recording(rig)
    assert repr(recording).startswith('<Recording cell_7: displacement ')
    assert repr(recording.force) == f'<Signal of {len(recording.force):,} samples>'
    result = cfd.identify(recording)
    assert repr(result) == '<Result of cell_7: cylinder_a, cylinder_b, force>'
    assert repr(result.device) == '<Device: cylinder_a; cylinder_b; force>'
    assert str(result.device) == result.device.text
    assert '\x1b' not in result._repr_html_()  # no colours of a terminal


def test_only_what_this_package_wrote_is_replaced_unasked(rig, tmp_path):
    result = cfd.identify(cfd.read_recording(rig))
    limits = cfd.Limits(stroke=3e-3, speed=0.1, acceleration=2.0, pressures=(35e3, 70e3), duration=3.0)
    plan = cfd.plan(result.device, limits, wanted=['k_x'])
    for save, path, name in (
        (result.save, tmp_path / 'found', 'report.json'),
        (plan.save, tmp_path / 'next', 'schedule.csv'),
        (result.device.save, tmp_path / 'parameters.yaml', ''),
    ):
        save(path)
        save(path)
        (path / name).write_text('mine')
        with pytest.raises(cfd.InputError, match=f'{path / name} exists and may be yours: .*overwrite=True'):
            save(path)
        assert (path / name).read_text() == 'mine'
        save(path, overwrite=True)
        assert (path / name).read_text() != 'mine'
    result.device.save(tmp_path / 'found' / 'parameters.yaml')  # which identify_bag writes, too


def test_a_device_is_not_saved_over_a_folder(rig, tmp_path):
    device = cfd.identify(cfd.read_recording(rig)).device
    (tmp_path / 'cell').mkdir()
    (tmp_path / 'cell' / 'notes').touch()
    with pytest.raises(cfd.InputError, match='cell is a folder and is not replaced'):
        device.save(tmp_path / 'cell', overwrite=True)
    assert (tmp_path / 'cell' / 'notes').exists()


def test_a_path_is_not_a_recording(rig):
    for given in ('cell_7', rig, [rig]):
        with pytest.raises(cfd.InputError, match=r'cell_7.*[.] Read the bag first, with read_recording'):
            cfd.identify(given)


def walked(recording: cfd.Recording, folder: Path, core: str = 'auto') -> cfd.Result:
    """Do what the page says with a recording, and check what it says of it."""
    result = cfd.identify([recording], close_loop=True, area=1.14e-3, geometric_factor=1.0, core=core)
    assert all(f'{name}: ' in str(result) for name in recording.cylinders)
    axes = result.plot()
    assert len(axes) == 2 * len(result.identification.channels)
    assert {path.name for path in result.save(folder / 'cell_7')} == {
        'report.json',
        'parameters.yaml',
        'report.html',
        'compare.mcap',
    }
    assert '<iframe' in result._repr_html_()
    device = result.device
    simulated = device.simulate(result.recordings[0])
    assert set(simulated.cylinders) == set(recording.cylinders)
    for name, signals in simulated.cylinders.items():
        measured = recording.cylinders[name].pressure
        assert np.isin(signals.pressure.times, measured.times).all()
        assert signals.setpoint is not None
        test = result.report['cylinders'][name]['after']['test']
        begin = result.report['split']['recordings'][0]['test_from_s']
        at = np.searchsorted(measured.times, signals.pressure.times)
        left = (measured.values[at] - signals.pressure.values)[signals.pressure.times >= begin]
        assert np.sqrt(np.mean(left**2)) == pytest.approx(test['rmse_pa'], rel=0.01)
        assert result.report['cylinders'][name]['live']['test']['rmse_pa'] > 0.0
    assert len(simulated.force) > 0
    device.save(folder / 'parameters.yaml')
    assert cfd.Device.load(folder / 'parameters.yaml') == device
    run, _, rest = (folder / 'cell_7' / 'parameters.yaml').read_text().partition('\n')
    assert run.startswith('# identify_bag, run ')
    assert (folder / 'parameters.yaml').read_text().partition('\n')[2] == rest
    return result


@pytest.mark.slow
def test_the_lines_run_on_the_rig(rig, tmp_path):
    result = walked(cfd.read_recording(rig), tmp_path)
    assert 'leakage' in result.device.model.cylinders['cylinder_a'].effects
    assert set(result.device.model.cylinders) == {'cylinder_a', 'cylinder_b'}
    assert result.recordings[0] is result.identification.recordings[0], 'its set-points were recorded'
    limits = cfd.Limits(stroke=3e-3, speed=0.1, acceleration=2.0, pressures=(35e3, 70e3), duration=8.0)
    plan = cfd.plan(result.device, limits)
    assert 'predicted standard errors' in str(plan)
    names = {path.name for path in plan.save(tmp_path / 'next')}
    assert names == {'plan.html', 'schedule.csv', 'plan.json', 'schedule.svg'}


@pytest.mark.slow
@needs_measured_data
def test_the_lines_run_on_a_measured_run(tmp_path):
    run = cfd.read_recording(ROOT / 'friction' / 'O-ring257_3bar.csv', mapping=MAPPING)
    result = walked(run, tmp_path, core='linear')
    assert set(result.device.model.cylinders) == {'cylinder_a'}
    assert {'setpoint_drifts', 'waves_left_out'} <= {one['code'] for one in result.report['warnings']}
    # a displacement that comes late has to be foretold, which a live simulation does from its noisy speed
    ((name, (late,)),) = result.device.model.cylinders['cylinder_a'].effects.items()
    assert name in {'displacement_delay', 'displacement_lag'}
    assert late > 0.02
    block = result.report['cylinders']['cylinder_a']
    assert block['live']['test']['rmse_pa'] > 2.0 * block['after']['test']['rmse_pa']


def test_several_paths_are_a_list_and_a_single_recording_needs_no_brackets(rig):
    first, second = cfd.read_recording([rig, str(rig)])
    assert str(first) == str(second)
    result = cfd.identify(first)
    assert '<pre>' in result._repr_html_()
    assert result.report == cfd.identify([second]).report


def has_run(cells):
    """Return whether cells ended well and drew what the page says."""
    outputs = [output for cell in cells if cell.cell_type == 'code' for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == 'error']
    return sum('image/png' in output.get('data', {}) for output in outputs) >= 2


def test_the_notebook_is_the_page_and_has_run():
    kept = nbformat.read(NOTEBOOK, 4)
    assert [cell.source for cell in kept.cells] == [cell.source for cell in notebook().cells], 'make notebook'
    assert has_run(kept.cells)
    assert NOTEBOOK.stat().st_size < 1_000_000


@pytest.mark.long
def test_the_notebook_runs(tmp_path):
    assert has_run(executed(tmp_path).cells)


def test_what_is_offered_is_documented_and_is_there():
    assert set(dir(cfd)) == {*cfd.__all__, '__doc__', '__version__'}
    assert all(inspect.getdoc(getattr(cfd, name)) for name in cfd.__all__)
    help_page = pydoc.plain(pydoc.render_doc(cfd))
    assert all(name in help_page for name in cfd.__all__)
    assert 'import_module' not in help_page


@pytest.mark.parametrize(
    'wrong',
    [
        lambda: cfd.identify([]),
        lambda: cfd.identify('bag'),
        lambda: cfd.identify([None]),
        lambda: cfd.Device.load(TABLE_1).simulate('x'),
        lambda: cfd.Device.load(TABLE_1).simulate(None, raw=True),
    ],
)
def test_what_is_no_recording_is_an_error_for_the_user(wrong):
    with pytest.raises(cfd.InputError, match='recording'):
        wrong()
    with pytest.raises(AttributeError):
        _ = cfd.nothing


WRONG = {
    'recordings': (lambda made: cfd.identify(None), 'recordings must be a recording or a list of recordings, not None'),
    'area': (lambda made: cfd.identify(made, area='1e-3'), 'area must be a number, not str'),
    'area true': (lambda made: cfd.identify(made, area=True), 'area must be a number, not True'),
    'close_loop': (lambda made: cfd.identify(made, close_loop='no'), 'close_loop must be True or False, not str'),
    'fractions': (lambda made: cfd.identify(made, fractions=0.6), 'fractions must be three shares, not float'),
    'share': (lambda made: cfd.identify(made, fractions='0.6'), 'a share of fractions must be a number, not str'),
    'tolerance': (lambda made: cfd.identify(made, tolerance=5), 'tolerance must be a text such as 300Pa'),
    'path': (lambda made: cfd.read_recording(None), 'path must be a path or a list of paths, not None'),
    'paths': (lambda made: cfd.read_recording([None]), 'path must be a path or a list of paths, not None'),
    'mapping': (
        lambda made: cfd.read_recording('x', mapping={}),
        'mapping must be a mapping file, or what .*, not dict',
    ),
    'ambient': (
        lambda made: cfd.read_recording('x', ambient_pressure='1'),
        'ambient_pressure must be a number, not str',
    ),
    'joint': (lambda made: cfd.read_recording('x', joint=None), 'joint must be a text, not None'),
    'mapping file': (lambda made: cfd.read_mapping(None), 'path must be a path, not None'),
    'bag': (lambda made: cfd.write_recording(None, made), 'path must be a path, not None'),
    'no recording': (lambda made: cfd.write_recording('x', 'y'), 'recording must be a recording, not str'),
    'device file': (lambda made: cfd.Device.load(None), 'path must be a path, not None'),
    'parameters': (lambda made: cfd.Device(None), 'given must be a dictionary of parameters, not None'),
    'saved device': (lambda made: cfd.Device.load(TABLE_1).save(None), 'path must be a path, not None'),
    'overwrite': (lambda made: cfd.Device({}).save('x', overwrite='no'), 'overwrite must be True or False, not str'),
    'set-points': (lambda made: cfd.Device({}).simulate(made, setpoints=3e5), 'setpoints must be a dictionary such as'),
    'set-point': (
        lambda made: cfd.Device({}).simulate(made, setpoints={'cylinder_a': '3'}),
        'the set-point of cylinder_a must be a number, not str',
    ),
    'set-point in bar': (
        lambda made: cfd.Device({}).simulate(made, setpoints={'cylinder_a': 3}),
        'the set-point of cylinder_a is 3 Pa: give pascals above ambient, 3e5 for 3 bar',
    ),
    'raw': (lambda made: cfd.Device({}).simulate(made, raw='no'), 'raw must be True or False, not str'),
    'ambient of a decay': (lambda made: cfd.decay_of(made.displacement, 'x'), 'ambient_pressure must be a number'),
    'decay': (lambda made: cfd.decay_of(made, 101_325), 'signal must be a signal, such as .*, not Recording'),
    'device': (lambda made: cfd.plan(None, cfd.Limits((35e3, 70e3))), 'device must be a device, not None'),
    'limits': (lambda made: cfd.plan(cfd.Device({}), None), 'limits must be Limits, not None'),
    'pressures': (lambda made: cfd.Limits(35e3), 'pressures must be the lowest and the highest set-point, not float'),
    'three pressures': (lambda made: cfd.Limits((1e3, 2e3, 3e3)), 'pressures has 3 numbers: give the lowest and the'),
    'a pressure': (lambda made: cfd.Limits(('1', '2')), 'a set-point of pressures must be a number, not str'),
    'stroke': (lambda made: cfd.Limits((35e3, 70e3), stroke='3'), 'stroke must be a number, not str'),
    'stroke in millimetres': (lambda made: cfd.Limits((35e3, 70e3), stroke=-1), 'stroke -1 m: give metres'),
    'sensing': (lambda made: cfd.Sensing(sample_rate='500'), 'sample_rate must be a number, not str'),
}


@pytest.mark.parametrize(('call', 'message'), WRONG.values(), ids=WRONG.keys())
def test_an_argument_of_a_wrong_type_is_an_error_for_the_user(call, message):
    times = np.linspace(0.0, 2.0, 1001)
    made = cfd.Recording.from_arrays(times, 1e-3 * np.sin(times), {'cylinder_a': 1.5e5 + 1e3 * times})
    with pytest.raises(cfd.InputError, match=f'^{message}'):
        call(made)


def test_a_plot_without_matplotlib_is_an_error_for_the_user(monkeypatch):
    monkeypatch.setitem(sys.modules, 'matplotlib.pyplot', None)
    monkeypatch.delitem(sys.modules, 'cfd_pneumatic.reporting.overview_plot', raising=False)
    monkeypatch.delitem(vars(reporting), 'overview', raising=False)  # or the package has loaded it already
    with pytest.raises(cfd.InputError, match=r"pip install 'cfd_pneumatic\[plot\]'"):
        cfd.Result(None).plot()


IMPORTED = """
import os, pkgutil, signal
import matplotlib, numba, numpy, yaml

def settings():
    numba_settings = {name: str(value) for name, value in vars(numba.config).items() if name.isupper()}
    own = dict(matplotlib.rcParams)
    return dict(os.environ), numba_settings, numpy.geterr(), own, str(signal.getsignal(signal.SIGINT))

before = settings()
import cfd_pneumatic as cfd
assert 'cfd_pneumatic.api' not in __import__('sys').modules
for module in pkgutil.walk_packages(cfd.__path__, 'cfd_pneumatic.'):
    if '.nodes' not in module.name and '.plant' not in module.name:
        __import__(module.name)
cfd.Device({}).model.at_rest(2e5, 2e5)
assert settings() == before
"""


def test_importing_changes_no_setting_of_the_process():
    subprocess.run([sys.executable, '-c', IMPORTED], check=True)
