# SPDX-License-Identifier: Apache-2.0
"""Effects on the contact force sample by sample: the live device does what the simulation of a recording does."""

import math

import numpy as np
import pytest
from reference import AMBIENT, PSI

from cfd_pneumatic.model import TABLE_1, Arrival, Cylinder, DeviceModel, ForceGeometry, LiveDevice
from cfd_pneumatic.model.effects import FORCE_PARTS
from cfd_pneumatic.model.extended_force import ExtendedForce

GEOMETRY = ForceGeometry(area=1.1e-3, geometric_factor=1.5, ambient_pressure=AMBIENT)
START = 1_000_000_000_000
AMPLITUDE, OMEGA = 2e-3, 2.0 * math.pi * 1.5
STRONG = {
    'moving_mass': (0.4, 0.3),
    'seal_friction': (2.0, 2e-5, 40.0, 1e-4),
    'stribeck_friction': (1.0, 5e-3, 3e-5),
    'force_offset': (-0.7,),
    'force_curve': (1.0, 0.0, 5e-5, -1e-3, 1e-3, 0.0, 1e6, *(0.1 * knot for knot in range(17))),
}
CASES = [*({name: own} for name, own in STRONG.items()), STRONG]
SETPOINTS = (AMBIENT + 8.0 * PSI, AMBIENT + 4.0 * PSI)


def make_device(effects, *, play=0.0, single=False):
    cylinder = Cylinder(TABLE_1, AMBIENT)
    return DeviceModel(cylinder, None if single else cylinder, GEOMETRY, effects, play)


def make_samples(count=800):
    """Return irregular stamps [ns], times since the first [s], and a smooth motion [m]."""
    rng = np.random.default_rng(8)
    stamps = START + np.cumsum(rng.integers(1_500_000, 2_500_000, count))
    times = (stamps - stamps[0]) * 1e-9
    return stamps.tolist(), times, AMPLITUDE * np.sin(OMEGA * times)


STAMPS, TIMES, X = make_samples()
RATE = AMPLITUDE * OMEGA * np.cos(OMEGA * TIMES)
STEPS = np.diff(TIMES)


def follow(live, positions=X, part=slice(None)):
    """Return the states of the device at the samples."""
    states = []
    for stamp, position in list(zip(STAMPS, positions.tolist()))[part]:
        assert live.sample(stamp, position, SETPOINTS) in (Arrival.FIRST, Arrival.ADVANCED)
        states.append(live.committed.state)
    return states


def forces(live, states):
    return np.array([live.device.contact_force(state) for state in states])


def recorded(effects, states, rate, acceleration, x=X):
    """Return the force that the simulation of a recording makes of these states' pressures [N]."""
    model = ExtendedForce(GEOMETRY.area * GEOMETRY.geometric_factor, effects, AMBIENT)
    a = np.array([state.a.p for state in states])
    b = None if states[0].b is None else np.array([state.b.p for state in states])
    return model.simulate_piece(model.begin(x[0]), TIMES[0], TIMES, x, rate, acceleration, a, b)


@pytest.mark.parametrize('single', [False, True])
@pytest.mark.parametrize('effects', CASES, ids=str)
def test_of_the_same_motion_it_is_the_simulation_of_a_recording(effects, single):
    """The speeds are the means over the steps, the accelerations their changes from middle to middle."""
    live = LiveDevice(make_device(effects, single=single), max_gap=0.1)
    states = follow(live)
    rate = np.concatenate([[0.0], np.diff(X) / STEPS])
    acceleration = np.zeros(TIMES.size)
    acceleration[2:] = np.diff(rate[1:]) / (0.5 * (STEPS[1:] + STEPS[:-1]))
    np.testing.assert_allclose(forces(live, states), recorded(effects, states, rate, acceleration), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize('effects', CASES, ids=str)
def test_for_a_smooth_motion_it_lags_by_no_more_than_a_step(effects):
    """
    Against the motion's own speed and acceleration.

    The mean speed is that of half a step before, and wrong by half a step times the acceleration at most; the
    acceleration comes as late as a step, and is wrong by a step times the jerk. Friction grows by no more than the
    viscous coefficient, and Stribeck's by (2 / e)^0.5 breakaway / speed, for each m/s.
    """
    live = LiveDevice(make_device(effects), max_gap=0.1)
    states = follow(live)
    expected = recorded(effects, states, RATE, -(OMEGA**2) * X)
    longest = np.max(STEPS)
    speed_error = 0.5 * longest * AMPLITUDE * OMEGA**2
    breakaway, speed, _ = effects.get('stribeck_friction', (0.0, 1.0, 1.0))
    slope = effects.get('seal_friction', (0.0,) * 4)[2] + math.sqrt(2.0 / math.e) * breakaway / speed
    tolerance = slope * speed_error + effects.get('moving_mass', (0.0,))[0] * longest * AMPLITUDE * OMEGA**3 + 1e-9
    moving = slice(2, None)  # at first it rests
    np.testing.assert_allclose(forces(live, states)[moving], expected[moving], rtol=0.0, atol=tolerance)
    shown = np.max(np.abs(expected - recorded({}, states, RATE, RATE)))
    assert tolerance < 0.15 * shown


def test_without_effects_it_is_area_times_difference():
    live = LiveDevice(make_device({}, play=1e-6), max_gap=0.1)
    for state in follow(live, part=slice(0, 20)):
        assert state.force is None
        assert live.device.contact_force(state) == GEOMETRY.contact_force(state.a.p, state.b.p)


@pytest.mark.parametrize('name', FORCE_PARTS)
def test_at_its_null_value_an_effect_is_absent(name):
    live = LiveDevice(make_device({name: FORCE_PARTS[name].null}), max_gap=0.1)
    states = follow(live)
    plain = [GEOMETRY.contact_force(state.a.p, state.b.p) for state in states]
    np.testing.assert_allclose(forces(live, states), plain, rtol=1e-13)


@pytest.mark.parametrize('effects', CASES, ids=str)
def test_effects_on_the_force_leave_the_pressures_alone(effects):
    plain = follow(LiveDevice(make_device({}), max_gap=0.1), part=slice(0, 100))
    states = follow(LiveDevice(make_device(effects), max_gap=0.1), part=slice(0, 100))
    assert [(state.a, state.b) for state in states] == [(state.a, state.b) for state in plain]


def test_the_first_sample_is_at_rest_with_its_weight():
    live = LiveDevice(make_device(STRONG), max_gap=0.1)
    (state,) = follow(live, part=slice(100, 101))
    pneumatic = GEOMETRY.contact_force(*SETPOINTS)
    assert live.device.contact_force(state) == pytest.approx(pneumatic - 0.4 * 9.80665 * math.sin(0.3) - 0.7)
    assert state.force.values[-1] == X[100]
    live.reset()
    assert follow(live, part=slice(100, 101)) == [state]


def test_a_first_movement_is_no_jerk():
    """After a gap the piston may have been moving all the time: its speed before is not known."""
    live = LiveDevice(make_device({'moving_mass': (5.0, 0.0)}), max_gap=0.1)
    _, moved = follow(live, part=slice(0, 2))
    assert live.device.contact_force(moved) == pytest.approx(GEOMETRY.contact_force(moved.a.p, moved.b.p))


def test_the_last_bit_of_a_sensor_does_not_turn_the_seals_round():
    bit = 3e-6
    effects = {'seal_friction': (2.0, 0.0, 0.0, 1e-5)}
    stroke = np.interp(TIMES, [0.1, 0.5], [0.0, 1e-3])
    toggling = stroke + bit * (np.arange(TIMES.size) % 2)

    def stretch(play):
        live = LiveDevice(make_device(effects, play=play), max_gap=0.1)
        return np.array([state.force.values[0] for state in follow(live, toggling)])

    moved, after = (TIMES > 0.2) & (TIMES < 0.5), TIMES > 0.51
    assert np.max(np.abs(stretch(0.0)[after])) < 0.5, 'it forgets'
    assert np.min(stretch(0.51 * bit)[moved]) > 0.99
    assert np.all(stretch(0.51 * bit)[after] == stretch(0.51 * bit)[-1])
    assert stretch(0.51 * bit)[-1] > 0.99


def test_play_delays_the_seals_turn_by_its_width_and_no_more():
    play = 2e-6
    live = LiveDevice(make_device({'seal_friction': (2.0, 0.0, 0.0, 1e-4)}, play=play), max_gap=0.1)
    held, slid = X[0], []
    for x in X:
        held = min(max(held, x - play), x + play)
        slid.append(held)
    states = follow(live)
    zero = np.zeros(TIMES.size)
    expected = recorded(live.device.force_effects, states, zero, zero, np.array(slid))
    np.testing.assert_allclose(forces(live, states), expected, rtol=0.0, atol=1e-9)
    exact = forces(live, follow(LiveDevice(make_device(live.device.force_effects), max_gap=0.1)))
    assert 0.01 < np.max(np.abs(exact - forces(live, states))) < 2.0 * 2.0 * 2.0 * play / 1e-4


def test_switched_on_and_off_on_the_way_the_others_go_on():
    steady = LiveDevice(make_device(STRONG), max_gap=0.1)
    states = follow(steady)
    live = LiveDevice(make_device(STRONG), max_gap=0.1)
    follow(live, part=slice(0, 300))
    live.device = make_device({name: own for name, own in STRONG.items() if name != 'force_offset'})
    without = forces(live, follow(live, part=slice(300, 400)))
    np.testing.assert_allclose(without, forces(steady, states)[300:400] + 0.7, rtol=0.0, atol=1e-9)
    live.device = make_device(STRONG)
    np.testing.assert_array_equal(forces(live, follow(live, part=slice(400, 500))), forces(steady, states)[400:500])
    live.device = make_device({'force_offset': (-0.7,)})
    follow(live, part=slice(500, 550))
    live.device = make_device(STRONG)
    assert live.preview(1e-8, SETPOINTS).force.values[0] == 0.0, 'it starts at rest'
    live.device = make_device({})
    assert follow(live, part=slice(550, 551))[0].force is None


def test_previews_commit_nothing():
    steady = follow(LiveDevice(make_device(STRONG), max_gap=0.1))
    live = LiveDevice(make_device(STRONG), max_gap=0.1)
    states = follow(live, part=slice(0, 300))
    for elapsed in (0.001, 0.05):
        ahead = live.preview(elapsed, SETPOINTS)
        assert ahead.force.moved.rate == 0.0
        assert ahead.force.values == pytest.approx(states[-1].force.values), 'the seals stay stretched'
    assert states + follow(live, part=slice(300, None)) == steady


def test_a_force_that_is_no_number_starts_the_device_anew():
    live = LiveDevice(make_device({'moving_mass': (1e308, 0.0)}), max_gap=0.1)
    live.sample(START, 0.0, SETPOINTS)
    assert live.sample(START + 1_000_000, 0.0, SETPOINTS) is Arrival.ADVANCED
    assert live.sample(START + 2_000_000, 1e-3, SETPOINTS) is Arrival.DIVERGED


@pytest.mark.parametrize(
    ('effects', 'message'),
    [
        ({'leakage': (0.1, 0.0)}, 'leakage is not an effect on the force'),
        ({'force_offset': ()}, 'force_offset has 0 parameters; expected 1'),
    ],
)
def test_effects_that_there_are_not_are_refused(effects, message):
    with pytest.raises(ValueError, match=message):
        make_device(effects)
