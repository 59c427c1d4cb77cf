# SPDX-License-Identifier: Apache-2.0
"""The foreign devices: physics with a known truth, repeatable tables, and tables that the reader understands."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from cfd_pneumatic.recording import read_mapping, read_recording
from studies.foreign.benchmark_foreign import Row, document
from studies.foreign.cylinder import ADIABATIC, AMBIENT, ROOM, Inputs, mass_flow, simulate
from studies.foreign.devices import KINDS, SETTLING, draw, pressures, record
from studies.foreign.excitation import Plan
from studies.foreign.tables import FORMATS, write_table
from studies.tools.json_rows import read_rows

BRIEF = Plan(seconds=4.0, steps=2)


def drafts(kind, seed=1, plan=BRIEF):
    return [draft for draft, _ in draw(KINDS[kind]._replace(plan=plan), [seed])]


def at_rest(seconds, target=2.6e5, supply=7e5):
    same = np.ones(round(1000 * seconds))
    return Inputs(0.0 * same, 0.0 * same, target * same, supply * same, ROOM * same, same, 0.0 * same)


@pytest.fixture(scope='module')
def recorded():
    return record('short', 3)


def test_sonic_flow_does_not_depend_on_the_pressure_behind():
    flows = [mass_flow(1e-8, 0.3, 6e5, ROOM, pressure, ROOM) for pressure in (1e5, 1.8e5)]
    np.testing.assert_allclose(flows, 1e-8 * 1.185 * 6e5)


def test_flow_is_continuous_at_the_laminar_limit_and_reverses():
    below, above = (mass_flow(1e-8, 0.3, 6e5, ROOM, 6e5 * ratio, ROOM) for ratio in (0.99 - 1e-9, 0.99 + 1e-9))
    assert below == pytest.approx(above, rel=1e-6)
    assert mass_flow(1e-8, 0.3, 5e5, ROOM, 6e5, ROOM) == -mass_flow(1e-8, 0.3, 6e5, ROOM, 5e5, ROOM)


def test_the_pressure_at_rest_is_the_setpoint():
    device = drafts('pi_spool')[0].cylinders[0]
    inputs = at_rest(6.0)
    step = inputs._replace(target=np.where(np.arange(6000) < 500, 2.2e5, 2.6e5))
    chamber, supply, temperature = simulate(device, step)
    overlap = max(device.supply_lap, device.exhaust_lap) / device.gain
    assert abs(chamber[-1] - 2.6e5) < overlap + device.integral_zone
    assert abs(chamber[499] - 2.2e5) < 1.0
    assert supply[-1] == pytest.approx(7e5, rel=1e-3)
    assert temperature[-1] == pytest.approx(ROOM, abs=0.1)


@pytest.mark.parametrize(('wall', 'exponent'), [(0.0, ADIABATIC), (1e3, 1.0)])
def test_a_closed_chamber_is_compressed_polytropically(wall, exponent):
    device = drafts('pi_spool')[0].cylinders[0]._replace(wall=wall)
    inputs = at_rest(1.5)
    share = np.clip(np.arange(1500) / 1000.0, 0.0, 1.0)
    moved = inputs._replace(
        position=-5e-3 * share**2 * (3.0 - 2.0 * share),
        velocity=-5e-3 * 6.0 * share * (1.0 - share),
        hose_opening=0.0 * share,
    )
    chamber, _, temperature = simulate(device, moved)
    start = device.dead_volume + device.area * device.length
    volume = start + device.area * moved.position
    np.testing.assert_allclose(chamber, 2.6e5 * (start / volume) ** exponent, rtol=2e-4)
    np.testing.assert_allclose(chamber * volume / temperature, 2.6e5 * start / ROOM, rtol=1e-6)  # mass


def test_compression_with_a_real_wall_is_between_isothermal_and_adiabatic():
    draft = drafts('pi_spool')[0]
    device, inputs = draft.cylinders[0], draft.inputs[0]
    closed = inputs._replace(hose_opening=0.0 * inputs.position)
    chamber, _, _ = simulate(device, closed)
    volume = device.dead_volume + device.area * (device.length + inputs.position)
    smallest = int(np.argmin(volume))
    ratio = volume[0] / volume[smallest]
    exponent = math.log(chamber[smallest] / chamber[0]) / math.log(ratio)
    assert ratio > 1.01
    assert 1.0 <= exponent <= ADIABATIC


def test_the_bore_changes_volume_and_area_consistently():
    device = drafts('bore_step')[1].cylinders[0]._replace(wall=1e3)
    inputs = at_rest(1.5)
    share = np.clip(np.arange(1500) / 1000.0, 0.0, 1.0)
    moved = inputs._replace(
        position=4e-3 * (share**2 * (3.0 - 2.0 * share)),
        velocity=4e-3 * 6.0 * share * (1.0 - share),
        hose_opening=0.0 * share,
    )
    chamber, _, temperature = simulate(device, moved)
    area = device.area * (1 + 0.5 * device.bore_change * (1 + np.tanh((moved.position - device.bore_position) / 5e-4)))
    swept = np.append(0.0, np.cumsum(0.5 * (area[1:] + area[:-1]) * np.diff(moved.position)))
    growth = temperature / temperature[0] * chamber[0] / chamber - 1.0  # of the volume; no gas enters or leaves
    start = swept[-1] / growth[-1]
    assert start == pytest.approx(device.dead_volume + device.area * device.length, rel=0.01)
    np.testing.assert_allclose(start * growth, swept, atol=1e-4 * swept[-1])


def test_a_sagging_supply_is_below_its_nominal_pressure_under_flow():
    draft = drafts('sagging_supply')[0]
    _, _, supply = pressures(draft)
    assert supply.min() < 0.97 * 7e5
    assert supply.max() <= 7e5 * (1.0 + 1e-9)


def test_a_leak_lowers_the_pressure_of_a_chamber_without_supply():
    healthy, leaky = (draft.cylinders[0] for draft in drafts('leak_orifice'))
    closed = at_rest(2.0)._replace(hose_opening=np.zeros(2000))
    assert simulate(healthy, closed)[0][-1] == pytest.approx(2.6e5)
    assert AMBIENT < simulate(leaky, closed)[0][-1] < 2.55e5


@pytest.mark.parametrize('kind', ['hose_kink', 'sticking_valve', 'supply_down'])
def test_a_change_does_nothing_before_its_time(kind):
    healthy, faulty = drafts(kind, plan=Plan(seconds=6.0, steps=4))
    healthy.cylinders[0] = faulty.cylinders[0]  # the supply that falls has a smaller tank
    differs = np.flatnonzero(pressures(faulty)[0][0] != pressures(healthy)[0][0])
    inputs = zip(faulty.inputs[0], healthy.inputs[0])
    begin = min(np.flatnonzero(after != before)[0] for after, before in inputs if np.any(after != before))
    assert 0.3 * 6000 <= begin - SETTLING <= 0.7 * 6000
    assert differs[0] >= begin - SETTLING


def test_drifts_change_what_is_read_and_not_what_is_commanded():
    healthy, faulty = drafts('sensor_drift')
    read, true, _ = pressures(faulty)
    drift = read[0] - true[0]
    assert drift[0] == 0.0
    assert 2e3 <= abs(drift[-1]) <= 6e3
    np.testing.assert_array_equal(faulty.commands[0], healthy.commands[0])
    late = drafts('late_command')[1]
    steps = [np.flatnonzero(np.diff(values))[0] for values in (late.commands[0], late.inputs[0].target)]
    assert 20 <= steps[1] - steps[0] <= 60


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_can_be_simulated(kind):
    draft = drafts(kind, plan=KINDS[kind].plan._replace(seconds=1.0, steps=1))[-1]
    read, _, _ = pressures(draft)
    assert len(read) == KINDS[kind].plan.cylinders
    assert all(1.5e5 < pressure.min() < pressure.max() < 4e5 for pressure in read)


def test_the_same_seed_gives_the_same_table(recorded, tmp_path):
    texts = []
    for name, again in (('first', recorded), ('second', record('short', 3)), ('third', record('short', 4))):
        (tmp_path / name).mkdir()
        texts.append(write_table(again, 'german', tmp_path / name)[0].read_text())
    assert texts[0] == texts[1] != texts[2]


@pytest.mark.parametrize('name', FORMATS)
def test_every_format_is_read(name, recorded, tmp_path):
    times = recorded.times
    both = replace(
        recorded,
        pressures=[recorded.pressures[0], 5e5 - recorded.pressures[0]],
        setpoints=[recorded.setpoints[0], 5e5 - recorded.setpoints[0]],
        force=20.0 * np.sin(times),
    )
    path, mapping = write_table(both, name, tmp_path)
    found = read_recording(path, mapping=read_mapping(mapping))
    np.testing.assert_allclose(found.displacement.times - found.displacement.times[0], times, atol=1e-6)
    np.testing.assert_allclose(found.displacement.values - both.displacement, 0.0, atol=0.1e-6)
    for letter, pressure, setpoint in zip('ab', both.pressures, both.setpoints):
        cylinder = found.cylinders[f'cylinder_{letter}']
        np.testing.assert_allclose(cylinder.pressure.values, pressure, atol=1.0)
        steps = np.append(0, np.flatnonzero(np.diff(setpoint)) + 1)  # the reader keeps the changes
        np.testing.assert_allclose(cylinder.setpoint.values, setpoint[steps], atol=1.0)
    np.testing.assert_allclose(found.force.values, both.force, atol=1e-3)


ROW = Row(
    kind='hose_kink',
    seed=7,
    format='german',
    truth='hose passes 30 % of its flow from 20.0 s on',
    contrast=3.0,
    exit_code=0,
    message='',
    channels={
        'cylinder_a': {
            'verdict': 'effect_added',
            'status': 'hypothesis',
            'named': ['line_restriction'],
            'over_noise': 1.2,
            'before': 200.0,
            'after': 90.0,
            'unit': 'Pa',
        }
    },
    warnings=['changed'],
    wall=9.0,
    processor=8.0,
    unit_wall=1.0,
    unit_processor=0.5,
    code='abc',
    commit='1234567',
)


def test_the_document_has_answers_and_units():
    stopped = replace(ROW, seed=8, exit_code=None, channels={}, warnings=[], wall=900.0)
    text = document([ROW, stopped], 'command', '')
    assert (
        'cylinder_a effect_added (hypothesis): line_restriction | 1.20 | 200 → 90 Pa | changed | 9.0 | 16.0 |' in text
    )
    assert '| one cylinder | wall | 10.0 | 1 of 2 | 900.0 (hose_kink 8) |' in text
    assert '| hose_kink | stopped: 1, effect_added: 1 |' in text


def test_a_run_continues_from_its_rows(tmp_path):
    path = tmp_path / 'rows.jsonl'
    lines = [json.dumps(asdict(ROW)), json.dumps(asdict(replace(ROW, seed=8, code='old'))), '{"kind": "hose']
    path.write_text('\n'.join(lines))
    assert list(read_rows(path, Row, 'abc')) == [ROW]
    assert list(read_rows(tmp_path / 'missing.jsonl', Row, 'abc')) == []
