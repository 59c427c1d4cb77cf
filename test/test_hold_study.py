# SPDX-License-Identifier: Apache-2.0
"""The study of predicted and held forces: its devices and surfaces, a small run on the rig, and its document."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cfd_pneumatic.arrays import rms
from cfd_pneumatic.device import Device
from cfd_pneumatic.path import IdentifiedDevice, PathSimulator, Prediction, preview_force, schedule_text
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.rig import DEVICES
from studies.hold import benchmark_hold, scenarios
from studies.hold.controllers import ControllerGains, controlled_errors, formula_setpoints
from studies.hold.devices import RANGE, draw_device, draw_recording
from studies.hold.document import document
from studies.hold.playing import PERIOD, play, played_feed, schedule_of, true_error
from studies.hold.rows import Row, prediction_figures
from studies.hold.surfaces import HEIGHT, PathTask, draw_task, scanned
from studies.tools.json_rows import read_rows

ROOT = Path(__file__).parents[1]
AREA = DEVICES['real'].cylinder_a.area


@pytest.fixture(scope='module')
def task():
    return draw_task(2000, 0, 4.0)


@pytest.fixture(scope='module')
def identified():
    """Return a device near the rig's `real`, without an identification."""
    return IdentifiedDevice.of_device(Device.load(ROOT / 'config' / 'table_1.yaml'))


@pytest.fixture(scope='module')
def constant(identified, task):
    return preview_force(identified, task.surface, task.order()).constant


def with_force(prediction: Prediction, force, half) -> Prediction:
    """Return a prediction with a force and half of a band on its grid [N]."""
    response = prediction.response._replace(force=force)
    return replace(prediction, response=response, variances={'model': (half / 1.96) ** 2})


@pytest.mark.parametrize('seed', range(2000, 2010))
def test_a_device_reaches_the_forces_of_its_surfaces(seed):
    device = draw_device(seed)
    assert device.facts['is_exact'] == (seed % 2 == 0)
    assert device.facts['dead_time'] + device.facts['lag'] <= 0.06
    recording = draw_recording(seed)
    stroke = [np.min(recording.positions), np.max(recording.positions)]
    differences = -np.diff(recording.setpoints, axis=1) * device.rig.cylinder_a.area
    for number in range(5):
        task = draw_task(seed, number)
        assert np.ptp(task.surface.error) < 1.1 * np.ptp(stroke)
        assert np.min(differences) < task.force < np.max(differences)


def test_the_devices_differ_as_planned():
    facts = [draw_device(seed).facts for seed in range(2000, 2010)]
    assert facts[0] == draw_device(2000).facts
    assert {entry['leak'] for entry in facts} > {''}
    assert 0 < sum(entry['dead_time'] + entry['lag'] > 0.0 for entry in facts) < 10
    assert sum(entry['friction'] > 0.0 for entry in facts) > 5


@pytest.mark.parametrize('number', range(4))
def test_a_surface_is_slow_enough_and_rests_at_its_ends(number):
    task = draw_task(2003, number)
    times = task.surface.along / task.feed
    error = task.surface.error
    assert HEIGHT[0] < np.std(error) < HEIGHT[1] + 0.1 * task.burr
    spectrum = np.abs(np.fft.rfft(error * np.hanning(error.size))) ** 2
    frequencies = np.fft.rfftfreq(error.size, times[1])
    assert np.sum(spectrum[frequencies > 12.0]) < 1e-4 * np.sum(spectrum)
    speed = np.gradient(error, times)
    assert np.max(np.abs(speed[[0, -1]])) < 1e-3
    assert np.max(np.abs(speed)) > 5e-3


def test_a_scan_has_the_wanted_error(task):
    error = scanned(task.surface, 5e-5, seed=3).error - task.surface.error
    assert rms(error) == pytest.approx(5e-5)
    assert not np.array_equal(error, scanned(task.surface, 5e-5, seed=4).error - task.surface.error)


def test_the_rig_plays_the_predicted_path_and_late_setpoints(constant):
    levels = {
        name: Signal(np.array([-0.5, 1.0]), np.array([level, level + 1e3]))
        for name, level in constant.setpoints.items()
    }
    stepped = replace(constant, setpoints=levels)
    answer = play(stepped, DEVICES['real'], late=0.005)
    path = constant.path
    played = np.interp(path.grid - path.grid[0], answer.truth.times, answer.truth.displacement)
    np.testing.assert_allclose(played, path.displacement_at(path.grid), atol=1e-8)
    steps = [np.flatnonzero(np.diff(schedule_of(stepped, late).setpoints[:, 0]))[0] for late in (0.0, 0.005)]
    assert PERIOD * steps[0] == pytest.approx(1.5)
    assert PERIOD * (steps[1] - steps[0]) == pytest.approx(0.005)
    assert schedule_text(stepped).count('\n') == path.grid.size + 1


def test_missed_violations_are_beyond_tolerance_and_band(constant):
    on_path, target = constant.path.is_on_path, constant.target
    force = np.full(constant.path.grid.size, target)
    force[np.flatnonzero(on_path)[100:200]] = target + 3.0
    prediction = with_force(replace(constant, tolerance=2.0), force, np.full(force.size, 0.5))
    true = np.zeros(np.count_nonzero(on_path))
    true[100:200] = 3.0  # predicted
    true[300:350] = 2.4  # beyond the tolerance, but not beyond the band
    true[400:420] = -2.6  # not predicted
    figures = prediction_figures(prediction, true)
    assert (figures['violations'], figures['missed']) == (120, 20)
    assert figures['covered'] == pytest.approx(1.0 - 70 / true.size)


def test_the_formula_leads_the_pressure_by_the_gains(identified, constant, task):
    setpoints = formula_setpoints(identified.device, constant.path, constant.setpoints)
    simulator = PathSimulator(constant.path)
    error = simulator.simulate(identified.device, setpoints).force[constant.path.is_on_path] - task.force
    assert rms(error) < 0.35 * constant.rms_error


def test_a_controller_reduces_the_error_and_a_fast_one_oscillates(constant):
    still, gentle, wild = (
        rms(controlled_errors(constant, DEVICES['real'], gains, AREA)[0])
        for gains in (ControllerGains(0.0, 0.0), ControllerGains(0.4, 6.0), ControllerGains(3.0, 60.0))
    )
    assert gentle < 0.9 * still < wild
    assert still == pytest.approx(rms(true_error(constant, DEVICES['real'])), rel=1e-6)


def test_the_played_feed_keeps_the_tolerance(constant, task):
    largest = np.max(np.abs(true_error(constant, DEVICES['real'])))
    limited = PathTask(task.surface, task.feed, 10.0 * largest, task.burr)  # the tolerance is the largest error
    found = played_feed(constant, limited, DEVICES['real'], 0.8 * task.feed)
    assert found == pytest.approx(task.feed, rel=0.03)
    assert played_feed(constant, limited, DEVICES['real'], 0.3 * task.feed) == np.inf
    assert played_feed(constant, limited, DEVICES['real'], 3.0 * task.feed) == 0.0


def test_the_scenarios_are_played(identified, monkeypatch):
    monkeypatch.setattr(scenarios, 'RUNS', 1)
    monkeypatch.setattr(scenarios, 'FEEDS', (0.1,))
    figures = scenarios.play_scenarios(DEVICES['real'], identified)
    assert set(figures) == {
        'at rest',
        *(f'{surface}, 100 mm/s, {control}' for surface in ('flat', 'sloped') for control in ('constant', 'held')),
        'step of +10 N',
        'step of -10 N',
    }
    assert figures['at rest']['standard deviation'] < 0.1
    assert 0.0 < figures['step of +10 N']['settling time'] < 1.0
    assert figures['sloped, 100 mm/s, constant']['largest error'] > 0.1


def test_a_small_run_writes_rows_and_continues(tmp_path, capsys):
    rows, page = tmp_path / 'rows.jsonl', tmp_path / 'hold.md'
    arguments = ['--seeds', '2004:2005', '--surfaces', '1', '--duration', '4', '--recording', '15', '--processes', '0']
    arguments += ['--rows', str(rows), '--output', str(page)]
    assert benchmark_hold.main(arguments) == 0
    (values,) = map(json.loads, rows.read_text().splitlines())
    assert values['message'] == ''
    assert values['errors']['held'] < values['errors']['constant']
    assert values['predicted']['constant']['rms'] == pytest.approx(values['errors']['constant'], rel=0.15)
    assert '## Requirements' in page.read_text()
    with page.open('a') as stream:
        stream.write('\n## Notes\n\nA note.\n')
    assert benchmark_hold.main(arguments) == 0
    assert '1 devices, 0 of them are not measured yet' in capsys.readouterr().out
    assert len(rows.read_text().splitlines()) == 1
    assert page.read_text().endswith('A note.\n')


def row(seed, held=0.3, **changes):
    facts = {'make': 'orifices', 'is_exact': seed % 2 == 0, 'friction': 0.2, 'leak': '', 'dead_time': 0.01, 'lag': 0.01}
    errors = {'constant': 2.0, 'held': held, 'controller': 1.5, 'formula': 0.5, 'scan wrong by 0.05 mm': 0.4}
    errors |= dict.fromkeys(('held, 50 Hz', 'held, 20 Hz', 'late by 5 ms', 'late by 10 ms'), 0.4)
    figures = {'rms': 2.1, 'half_band': 0.3, 'covered': 0.95, 'samples': 1000, 'violations': 10, 'missed': 0}
    made = Row(seed, 0, facts, {'force': 20.0, 'feed': 0.1, 'burr': 0.0}, 'abc', '1234567', errors=errors)
    return replace(made, predicted={'constant': figures, 'held': figures}, **changes)


def answers(rows):
    """Return the last two cells of each requirement by its first cell."""
    section = document(rows, 'command', '').partition('## Requirements')[2].partition('## Variants')[0]
    lines = [line.strip('| ').split(' | ') for line in section.splitlines() if line.startswith('| ')]
    return {cells[0]: tuple(cells[2:]) for cells in lines}


def test_the_document_judges_the_requirements():
    good = answers(
        [
            row(5000),
            row(5001, fastest={'predicted': None, 'played': None}),
            row(5002, fastest={'predicted': 0.1, 'played': 0.105}),
        ]
    )
    assert good['held / constant, median'] == ('0.15', 'yes')
    assert good['samples within the 95 % band, constant set-points'] == ('95.0 %', 'yes')
    assert good['missed violations'] == ('0.0 % (0 of 30)', 'yes')
    assert good['played fastest feed within 10 % of the predicted one'] == (
        '1 of 1 devices; 1 more are limited by friction',
        'yes',
    )
    bad = answers([row(5000, held=2.1), row(5001, fastest={'predicted': 0.1, 'played': float('inf')})])
    assert bad['held / constant, 90 % quantile'] == ('1.05', 'no')
    assert next(cells for text, cells in bad.items() if 'larger error held' in text) == ('1 of 2', 'no')
    assert bad['played fastest feed within 10 % of the predicted one'] == (
        '0 of 1 devices; 0 more are limited by friction',
        'no',
    )


def test_a_refused_surface_meets_no_requirement():
    refused = Row(5003, 0, row(5003).device, row(5003).path, 'abc', '1234567', message='the path is too long')
    found = answers([row(5000), refused])
    assert found['held / constant, 90 % quantile'] == ('inf', 'no')
    assert found['predicted RMS error within 15 % of the true RMS error'] == ('50.0 % (1 of 2)', 'no')
    assert 'device 5003: the path is too long' in document([row(5000), refused], 'command', '')


def test_rows_of_a_different_version_are_measured_again(tmp_path):
    path = tmp_path / 'rows.jsonl'
    path.write_text(json.dumps(vars(row(5000))) + '\n' + '{"seed": 5001\n')
    assert list(read_rows(path, Row, 'abc')) == [row(5000)]
    assert list(read_rows(path, Row, 'new')) == []
    assert list(read_rows(tmp_path / 'missing.jsonl', Row, 'abc')) == []


def test_the_range_of_the_regulators_is_below_every_supply():
    supplies = [draw_device(seed).rig.air for seed in range(2000, 2010)]
    assert RANGE.high < min(air.supply_pressure - air.ambient_pressure for air in supplies)
