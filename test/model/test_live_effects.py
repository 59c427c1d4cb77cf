# SPDX-License-Identifier: Apache-2.0
"""Effects sample by sample: the live device does what the fit's simulation does, and they go on and off on the way."""

import numpy as np
import pytest
from effect_cases import CASES, GAINS
from reference import AMBIENT, PSI

from cfd_pneumatic.model import (
    DIRECTIONS,
    TABLE_1,
    Arrival,
    Cylinder,
    CylinderState,
    DeviceModel,
    ExtendedCylinder,
    ForceGeometry,
    LiveDevice,
    Movement,
    OperatingPoints,
)
from cfd_pneumatic.model.effects import MODULES, PRESSURE_EFFECTS
from cfd_pneumatic.model.propagation import advance

CONSTANT = OperatingPoints.constant(*GAINS)
GEOMETRY = ForceGeometry(area=1.1e-3, geometric_factor=1.5, ambient_pressure=AMBIENT)
START = 1_000_000_000_000


def make_device(effects, points=CONSTANT):
    cylinder = Cylinder(points, AMBIENT, effects)
    return DeviceModel(cylinder, cylinder, GEOMETRY)


def make_samples(seed=3, count=240):
    """Return irregular stamps [ns], a stroke there and back [m], and set-points of A and B that step once [Pa]."""
    rng = np.random.default_rng(seed)
    stamps = START + np.cumsum(rng.integers(1_500_000, 2_500_000, count))
    times = (stamps - stamps[0]) * 1e-9
    positions = np.interp(times, [0.05, 0.06, 0.3, 0.31], [0.0, 1.5e-3, 1.5e-3, 0.0])
    a = np.where(times < 0.2, AMBIENT + 5.0 * PSI, AMBIENT + 5.5 * PSI)
    b = np.full(count, AMBIENT + 5.0 * PSI)
    return stamps, times, positions, a, b


STAMPS, TIMES, POSITIONS, SETPOINT_A, SETPOINT_B = make_samples()
SAMPLES = list(zip(STAMPS.tolist(), POSITIONS.tolist(), zip(SETPOINT_A.tolist(), SETPOINT_B.tolist())))


def follow(live, samples):
    """Return the states of the device at the samples."""
    states = []
    for stamp, position, setpoints in samples:
        assert live.sample(stamp, position, setpoints) in (Arrival.FIRST, Arrival.ADVANCED)
        states.append(live.committed.state)
    return states


def readings(states):
    return np.array([(state.a.reading, state.b.reading) for state in states])


def simulate_with_delays(name, own, displacement, setpoint):
    """Return the simulation of the fit at the samples [Pa]: commands and readings are late as in a fit."""
    cylinder, late = ExtendedCylinder(GAINS, {name: own}, AMBIENT), PRESSURE_EFFECTS[name].late
    if late != 'setpoint':
        return read_late(cylinder.simulate(TIMES, displacement, setpoint), own[0] if late == 'reading' else 0.0)
    changes = np.flatnonzero(np.diff(setpoint))
    acting_from = TIMES[changes] + own[0]
    times = np.union1d(TIMES, acting_from)
    commanded = np.append(setpoint[:1], setpoint[changes + 1])
    acting = commanded[np.searchsorted(acting_from, np.append(0.0, times[:-1]), side='right')]
    return cylinder.simulate(times, np.interp(times, TIMES, displacement), acting)[np.searchsorted(times, TIMES)]


def read_late(reading, delay):
    """Return what comes of a reading [Pa] with a delay: that of then, or what it goes to as it goes."""
    if delay >= 0.0:
        return np.interp(TIMES - delay, TIMES, reading)
    slope = np.diff(reading, prepend=reading[0]) / np.diff(TIMES, prepend=-1.0)
    return reading - delay * slope


@pytest.mark.parametrize(('name', 'own'), CASES)
def test_sample_by_sample_it_is_the_simulation_of_the_fit(name, own):
    live = readings(follow(LiveDevice(make_device({name: own}), max_gap=0.1), SAMPLES))
    for column, cylinder, setpoint in ((0, 'cylinder_a', SETPOINT_A), (1, 'cylinder_b', SETPOINT_B)):
        expected = simulate_with_delays(name, own, DIRECTIONS[cylinder] * POSITIONS, setpoint)
        np.testing.assert_allclose(live[:, column], expected, rtol=0.0, atol=1e-6)
    plain = readings(follow(LiveDevice(make_device({}), max_gap=0.1), SAMPLES))
    assert np.max(np.abs(live - plain)) > 1.0, 'the effect shows'


@pytest.mark.parametrize(('name', 'own'), CASES)
def test_over_a_recording_it_is_step_by_step_to_the_last_bit(name, own):
    cylinder = Cylinder(TABLE_1, AMBIENT, {name: own})
    state = begin = CylinderState(SETPOINT_A[0] + 300.0, SETPOINT_A[0] + 100.0)
    stepped = [state.reading]
    for i in range(1, TIMES.size):
        movement = Movement(TIMES[i], TIMES[i] - TIMES[i - 1], POSITIONS[i - 1], POSITIONS[i])
        state = cylinder.step(state, movement, SETPOINT_A[i])
        stepped.append(state.reading)
    np.testing.assert_array_equal(cylinder.simulate(TIMES, POSITIONS, SETPOINT_A, begin), stepped)


def test_gains_are_those_of_the_set_point():
    held = np.full(TIMES.size, AMBIENT + 7.0 * PSI)
    gains = TABLE_1.interpolate(7.0 * PSI).table[0, 1:]
    effects = {'leakage': (0.5, 0.0)}
    np.testing.assert_allclose(
        Cylinder(TABLE_1, AMBIENT, effects).simulate(TIMES, POSITIONS, held),
        ExtendedCylinder(gains, effects, AMBIENT).simulate(TIMES, POSITIONS, held),
        rtol=0.0,
        atol=1e-6,
    )


def test_without_effects_it_is_the_exact_propagation_to_the_last_bit():
    p = p_f = SETPOINT_A[0]
    expected = [p]
    for i in range(1, TIMES.size):
        duration = int(STAMPS[i] - STAMPS[i - 1]) * 1e-9
        rate = (POSITIONS[i] - POSITIONS[i - 1]) / duration
        p, p_f = advance(p, p_f, duration, rate, SETPOINT_A[i], *GAINS)
        expected.append(p)
    states = follow(LiveDevice(make_device({}), max_gap=0.1), SAMPLES)
    np.testing.assert_array_equal([state.a.p for state in states], expected)
    assert all(state.a.reading == state.a.p for state in states)


@pytest.mark.parametrize(('name', 'own'), CASES)
def test_switched_on_and_off_on_the_way_it_carries_the_pressures_over(name, own):
    """On the way of the stroke, where pressures are far from rest; in ten nanoseconds they can't move by much."""
    live = LiveDevice(make_device({}), max_gap=0.1)
    instant = 1e-8  # [s]
    looks_ahead = PRESSURE_EFFECTS[name].late == 'reading' and own[0] < 0.0
    forgets = hasattr(MODULES[name], 'signal') and not PRESSURE_EFFECTS[name].states
    for part, effects in ((SAMPLES[:28], {name: own}), (SAMPLES[28:31], {}), (SAMPLES[31:], {name: own})):
        follow(live, part)
        before = live.committed.state
        live.device = make_device(effects)
        after = live.preview(instant, part[-1][2])
        for old, new in ((before.a, after.a), (before.b, after.b)):
            assert new.p == pytest.approx(old.p, abs=0.5)
            assert new.p_f == pytest.approx(old.p_f, abs=0.5)
            if effects and not looks_ahead and not forgets:
                assert new.reading == pytest.approx(old.p, abs=0.5)


@pytest.mark.parametrize(('name', 'own'), [case for case in CASES if case.values[0] != 'leakage'])
def test_an_effect_that_stays_on_does_not_notice_others_come_and_go(name, own):
    steady = readings(follow(LiveDevice(make_device({name: own}), max_gap=0.1), SAMPLES))
    live = LiveDevice(make_device({name: own}), max_gap=0.1)
    states = follow(live, SAMPLES[:29])
    live.device = make_device({name: own, 'leakage': (0.0, 0.0)})
    states += follow(live, SAMPLES[29:34])
    live.device = make_device({name: own})
    states += follow(live, SAMPLES[34:])
    np.testing.assert_allclose(readings(states), steady, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(('name', 'own'), CASES)
def test_previews_commit_nothing(name, own):
    steady = follow(LiveDevice(make_device({name: own}), max_gap=0.1), SAMPLES)
    live = LiveDevice(make_device({name: own}), max_gap=0.1)
    states = follow(live, SAMPLES[:30])
    for elapsed in (0.001, 0.05):
        assert live.preview(elapsed, SAMPLES[30][2]).is_finite
    assert states + follow(live, SAMPLES[30:]) == steady


def test_time_counts_from_the_first_sample_after_a_reset():
    effects = {'set_point_drift': (1e3,), 'supply_variation': (300.0, 100.0, 2.0)}
    live = LiveDevice(make_device(effects), max_gap=0.1)
    once = follow(live, SAMPLES)
    live.reset()
    later = [(stamp + 77_000_000_000, position, setpoints) for stamp, position, setpoints in SAMPLES]
    assert follow(live, later) == once


def test_the_force_follows_from_the_chamber_and_not_from_the_sensor():
    exact = follow(LiveDevice(make_device({'leakage': (0.0, 0.0)}), max_gap=0.1), SAMPLES)
    lagging = follow(LiveDevice(make_device({'sensor_lag': (0.05,)}), max_gap=0.1), SAMPLES)
    device = make_device({})
    forces = [[device.contact_force(state) for state in states] for states in (exact, lagging)]
    np.testing.assert_allclose(*forces, atol=0.2)  # N; the shorter steps of the two differ by that
    assert max(abs(state.a.reading - state.a.p) for state in lagging) > 500.0


def test_a_delay_holds_the_reading_until_it_is_over():
    plain = readings(follow(LiveDevice(make_device({'leakage': (0.0, 0.0)}), max_gap=0.1), SAMPLES))
    live = LiveDevice(make_device({'leakage': (0.0, 0.0)}), max_gap=0.1)
    came = follow(live, SAMPLES[:29])[-1]
    live.device = make_device({'leakage': (0.0, 0.0), 'transport_delay': (0.1,)})
    late = readings(follow(live, SAMPLES[29:]))
    held = TIMES[29:] < TIMES[28] + 0.1
    np.testing.assert_array_equal(late[held], np.broadcast_to([came.a.reading, came.b.reading], late[held].shape))
    for column in (0, 1):
        expected = np.interp(TIMES[29:][~held] - 0.1, TIMES, plain[:, column])
        np.testing.assert_allclose(late[~held, column], expected, rtol=0.0, atol=1e-6)
    track = live.committed.state.a.track
    assert track.times[-1] - track.times[0] < 0.1 + 0.0025, 'no more is remembered than the delay needs'


def test_a_delay_that_goes_takes_its_memory_along():
    live = LiveDevice(make_device({'transport_delay': (0.02,)}), max_gap=0.1)
    follow(live, SAMPLES[:29])
    for effects in ({}, {'leakage': (0.0, 0.0)}, {'transport_delay': (-0.01,)}):
        live.device = make_device(effects)
        assert live.preview(0.001, SAMPLES[29][2]).a.track is None
    live.device = make_device({'leakage': (0.0, 0.0)})
    (gone,) = follow(live, SAMPLES[29:30])
    assert gone.a.reading == gone.a.p
    live.device = make_device({'transport_delay': (0.02,)})
    (back,) = follow(live, SAMPLES[30:31])
    assert back.a.reading == gone.a.reading


def test_a_delay_that_grows_holds_the_earliest_reading_that_it_knows():
    live = LiveDevice(make_device({'transport_delay': (0.004,)}), max_gap=0.1)
    states = follow(live, SAMPLES[:29])
    earliest = states[-1].a.track.readings[0]
    live.device = make_device({'transport_delay': (0.02,)})
    (state,) = follow(live, SAMPLES[29:30])
    assert state.a.reading == earliest


STEPPING = [
    (stamp, 0.0, (AMBIENT + (5.0 + (index // 20) % 2) * PSI, AMBIENT + 5.0 * PSI))
    for index, (stamp, _, _) in enumerate(SAMPLES)
]
"""Set-points of A that step every 20 samples, with the piston at rest."""


@pytest.mark.parametrize('delay', [0.0, 0.0007, 0.013, 0.1])
def test_a_set_point_acts_the_delay_after_its_command_to_a_fraction_of_a_sample(delay):
    """Against the paper's model, exactly integrated over grids that hold the times at which set-points act."""
    live = readings(follow(LiveDevice(make_device({'setpoint_delay': (delay,)}), max_gap=0.1), STEPPING))[:, 0]
    commanded = np.array([pair[0] for _, _, pair in STEPPING])
    changes = np.flatnonzero(np.diff(commanded))
    acting_from = TIMES[changes] + delay
    times = np.union1d(TIMES, acting_from)
    acting = commanded[np.append(0, changes + 1)][
        np.searchsorted(acting_from, np.append(0.0, times[:-1]), side='right')
    ]
    exact = Cylinder(CONSTANT, AMBIENT).simulate(times, np.zeros(times.size), acting)[np.searchsorted(times, TIMES)]
    np.testing.assert_allclose(live, exact, rtol=0.0, atol=5.0)
    assert np.ptp(live) > 4000.0


def test_no_more_commands_are_remembered_than_the_delay_needs():
    live = LiveDevice(make_device({'setpoint_delay': (0.1,)}), max_gap=0.1)
    for state in follow(live, STEPPING):
        begins = state.a.commands.begins
        assert len(begins) <= 0.1 / (20 * 0.0015) + 2
        assert begins[1:] == () or begins[1] > live.committed.movement(0.0, 0.0).time - 0.1 - 1.0
    assert len(state.a.commands.begins) >= 3
    assert state.b.commands.setpoints == (AMBIENT + 5.0 * PSI,)


def test_a_set_point_delay_that_appears_begins_with_the_present_command():
    live = LiveDevice(make_device({}), max_gap=0.1)
    follow(live, STEPPING[:30])
    live.device = make_device({'setpoint_delay': (0.1,)})
    (state,) = follow(live, STEPPING[30:31])
    assert state.a.commands.setpoints == (STEPPING[30][2][0],)
    live.device = make_device({'leakage': (0.0, 0.0)})
    (state,) = follow(live, STEPPING[31:32])
    assert state.a.commands is None


def test_an_acting_set_point_that_begins_to_lag_begins_at_the_command():
    live = LiveDevice(make_device({}), max_gap=0.1)
    follow(live, STEPPING[:22])
    assert live.committed.state.a.p < AMBIENT + 5.9 * PSI, 'the pressure is still rising'
    live.device = make_device({'setpoint_lag': (0.05,)})
    plain = LiveDevice(make_device({'leakage': (0.0, 0.0)}), max_gap=0.1)
    plain.committed = live.committed
    lagging, prompt = (readings(follow(one, STEPPING[22:40]))[:, 0] for one in (live, plain))
    np.testing.assert_allclose(lagging, prompt, rtol=0.0, atol=1.0)


def test_a_set_point_that_is_late_and_lags_splits_at_the_same_times():
    effects = {'setpoint_delay': (0.013,), 'setpoint_lag': (0.02,), 'transport_delay': (-0.004,)}
    live = readings(follow(LiveDevice(make_device(effects), max_gap=0.1), STEPPING))[:, 0]
    both = {name: effects[name] for name in ('setpoint_delay', 'setpoint_lag')}
    prompt = readings(follow(LiveDevice(make_device(both), max_gap=0.1), STEPPING))[:, 0]
    np.testing.assert_allclose(live, read_late(prompt, -0.004), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize('other', [{'leakage': (0.0, 0.0)}, {}])
def test_looking_ahead_starts_from_what_the_sensor_read(other):
    """A lagging sensor is hundreds of pascals off the chamber: mixed up, they would make a slope of a step."""
    lagging = {'sensor_lag': (0.02,)}
    live = LiveDevice(make_device(lagging), max_gap=0.1)
    before = follow(live, SAMPLES[:33])[-1]
    live.device = make_device({**lagging, **other, 'transport_delay': (-0.02,)})
    (state,) = follow(live, SAMPLES[33:34])
    reading = state.a.extended.reading
    assert abs(before.a.reading - before.a.p) > 300.0
    assert state.a.reading == pytest.approx(reading + 0.02 * (reading - before.a.reading) / (TIMES[33] - TIMES[32]))


@pytest.mark.parametrize(
    ('begin', 'end'),
    [
        ({'lost_motion': (2e-4,)}, {'lost_motion': (2e-4,), 'displacement_lag': (0.005,)}),
        ({'lost_motion': (2e-4,), 'displacement_lag': (0.005,)}, {'lost_motion': (2e-4,)}),
    ],
)
def test_play_that_stays_on_keeps_the_chamber_where_it_is(begin, end):
    """The whole play of 0.2 mm would be 800 Pa."""
    live = LiveDevice(make_device(begin), max_gap=0.1)
    before = follow(live, SAMPLES[:60])[-1]
    live.device = make_device(end)
    assert live.preview(1e-8, SAMPLES[60][2]).a.p == pytest.approx(before.a.p, abs=0.5)


def test_effects_that_leave_the_range_of_numbers_start_the_device_anew():
    live = LiveDevice(make_device({'operating_point': (0.5, 1e6, 1.0)}), max_gap=0.1)
    setpoints = SAMPLES[0][2]
    live.sample(START, 0.0, setpoints)
    assert live.sample(START + 1_000_000, 0.5, setpoints) is Arrival.DIVERGED, 'a root of a negative pressure'
    assert live.committed.state == live.device.at_rest(*setpoints, 0.5)
    assert live.sample(START + 2_000_000, 0.5, setpoints) is Arrival.ADVANCED
    assert live.committed.movement(0.001, 0.5).time == pytest.approx(0.002), 'time counts from there'
    live.committed = None
    live.sample(START, 0.0, setpoints)
    assert live.preview(0.01, (-1e9, -1e9)) is None


@pytest.mark.parametrize(
    ('effects', 'message'),
    [
        ({'leak': (0.1,)}, 'leak is not an effect on the pressure'),
        ({'leakage': ()}, 'leakage has 0 parameters; expected 2'),
    ],
)
def test_effects_that_there_are_not_are_refused(effects, message):
    with pytest.raises(ValueError, match=message):
        Cylinder(CONSTANT, AMBIENT, effects)
