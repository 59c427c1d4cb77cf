# SPDX-License-Identifier: Apache-2.0
"""Each effect on the contact force: null is the baseline, and strong it shows as physics has it."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import AMBIENT

from cfd_pneumatic.model.composed import FORCE_STATES, SLID, set_force_to_rest, step_force
from cfd_pneumatic.model.effects import (
    CORES,
    EFFECTS,
    FORCE_EFFECTS,
    FORCE_PARTS,
    GENERIC,
    PRESSURE_EFFECTS,
    PRESSURE_PARTS,
)
from cfd_pneumatic.model.effects.seal_friction import slide
from cfd_pneumatic.model.extended_force import ExtendedForce
from cfd_pneumatic.model.places import FORCE_PLACES, PLACES, all_force_parameters, force_switches

AREA = 1.14e-3
TIMES = np.arange(2001) * 1e-3
AMPLITUDE, OMEGA = 2e-3, 2.0 * np.pi * 1.5
X = AMPLITUDE * np.sin(OMEGA * TIMES)
RATE = AMPLITUDE * OMEGA * np.cos(OMEGA * TIMES)
ACCELERATION = -(OMEGA**2) * X
A = AMBIENT + 80e3 + 2e3 * np.cos(3.0 * TIMES)
B = AMBIENT + 30e3 + 1e3 * np.sin(2.0 * TIMES)
DATA = {'residual': 1.5, 'mean': -0.3, 'gauge': 1e5, 'largest_speed': 0.02, 'largest_acceleration': 0.2}


def force(effects, b=B, stretch=0.0):
    model = ExtendedForce(AREA, effects, AMBIENT)
    return model.simulate_piece(model.begin(X[0], stretch), TIMES[0], TIMES, X, RATE, ACCELERATION, A, b)


def change(effects, **options):
    """Return what effects change in the force [N]."""
    return force(effects, **options) - force({}, **{name: value for name, value in options.items() if name == 'b'})


def test_every_effect_is_on_the_force_or_on_the_pressure():
    assert {**PRESSURE_EFFECTS, **FORCE_EFFECTS} == EFFECTS
    assert {**CORES, **EFFECTS, **GENERIC} == {**PRESSURE_PARTS, **FORCE_PARTS}
    assert PRESSURE_PARTS.keys().isdisjoint(FORCE_PARTS)
    assert PRESSURE_PARTS.keys() == PLACES.keys()
    assert FORCE_PARTS.keys() == FORCE_PLACES.keys()
    assert PRESSURE_EFFECTS.keys().isdisjoint(FORCE_EFFECTS)
    assert FORCE_EFFECTS.keys() >= {'seal_friction', 'stribeck_friction', 'force_offset', 'moving_mass'}


def test_without_effects_it_is_area_times_difference():
    np.testing.assert_array_equal(force({}), AREA * (A - B))


def test_a_single_cylinder_works_against_ambient():
    np.testing.assert_array_equal(force({}, b=None), AREA * (A - AMBIENT))


@pytest.mark.parametrize('name', FORCE_PARTS)
def test_at_its_null_value_an_effect_is_exactly_absent(name):
    np.testing.assert_array_equal(force({name: FORCE_PARTS[name].null}, stretch=0.7), force({}))


@pytest.mark.parametrize('name', FORCE_EFFECTS)
def test_a_search_starts_within_bounds_and_off_the_baseline(name):
    effect = FORCE_EFFECTS[name]
    for start in effect.starts(DATA):
        assert len(start) == len(effect.parameters)
        assert all(one.lower <= value <= one.upper for one, value in zip(effect.parameters, start))
        assert np.max(np.abs(change({name: start}))) > 0.1


def test_an_offset_is_added():
    np.testing.assert_allclose(change({'force_offset': (-1.7,)}), -1.7, rtol=1e-12)


def test_a_mass_takes_inertia_and_weight():
    inclination = 0.4
    expected = -0.2 * (ACCELERATION + 9.80665 * math.sin(inclination))
    np.testing.assert_allclose(change({'moving_mass': (0.2, inclination)}), expected, atol=1e-11)


def test_friction_opposes_the_motion():
    """Once the seal is stretched, Coulomb friction of both cylinders' gauge pressures, and the viscous part."""
    held_back = -change({'seal_friction': (2.0, 1e-5, 15.0, 1e-5)})
    fast = np.abs(RATE) > 0.5 * AMPLITUDE * OMEGA
    fast[:50] = False
    expected = (2.0 + 1e-5 * (A + B - 2.0 * AMBIENT)) * np.sign(RATE) + 15.0 * RATE
    np.testing.assert_allclose(held_back[fast], expected[fast], rtol=1e-9)


def test_friction_never_drives():
    """Below ambient a friction affine in pressure would change its sign."""
    assert np.all(change({'seal_friction': (0.1, 1e-2, 0.0, 1e-5)}, b=np.full(TIMES.size, 0.05 * AMBIENT)) == 0.0)


def test_a_stretched_seal_is_felt_at_rest():
    still = np.zeros(TIMES.size)
    model = ExtendedForce(AREA, {'seal_friction': (2.0, 0.0, 0.0, 1e-4)}, AMBIENT)
    simulated = model.simulate_piece(model.begin(still[0], -1.0), TIMES[0], TIMES, still, still, still, A, B)
    np.testing.assert_allclose(simulated, AREA * (A - B) + 2.0, rtol=1e-12)


def test_presliding_is_dahls_model():
    """Dahl: dz = (1 - z sign(dx)) dx / rest displacement, here integrated in steps of a thousandth of a sample's."""
    presliding, fine = 3e-4, 1000
    z, expected = 0.0, [0.0]
    for begin, end in pairwise(X[:701]):
        dx = (end - begin) / fine
        sign = math.copysign(1.0, dx)
        for _ in range(fine):
            middle = z + 0.5 * (1.0 - z * sign) * dx / presliding
            z += (1.0 - middle * sign) * dx / presliding
        expected.append(z)
    assert np.ptp(expected) > 1.5
    assert np.mean(np.abs(expected) < 0.95) > 0.05
    stretch = -change({'seal_friction': (1.0, 0.0, 0.0, presliding)})[:701]
    np.testing.assert_allclose(stretch, expected, atol=1e-6)


travels = st.floats(-5e-3, 5e-3)


@given(st.floats(-1.0, 1.0), travels, st.floats(0.0, 1.0), st.floats(1e-6, 1e-2))
def test_a_stretch_does_not_depend_on_the_step_and_stays_bounded(stretch, travel, share, presliding):
    own = (0.0, 0.0, 0.0, presliding)
    (whole,) = slide(travel, stretch, *own)
    (part,) = slide(share * travel, stretch, *own)
    (rest,) = slide((1.0 - share) * travel, part, *own)
    assert rest == pytest.approx(whole, abs=1e-9)
    assert -1.0 <= whole <= 1.0
    assert math.copysign(1.0, travel) * (whole - stretch) >= -1e-15


def test_stribeck_friction_falls_with_the_speed():
    """On a way one way, over which the seal is stretched all the time."""
    speed, breakaway = 8e-3, 1.3
    model = ExtendedForce(AREA, {'stribeck_friction': (breakaway, speed, 1e-4)}, AMBIENT)
    rates = speed * np.linspace(0.0, 5.0, TIMES.size)
    still = np.zeros(TIMES.size)
    x = np.cumsum(rates) * 1e-3
    force = model.simulate_piece(model.begin(x[0], 1.0), TIMES[0], TIMES, x, rates, still, A, B)
    held_back = AREA * (A - B) - force
    np.testing.assert_allclose(held_back, breakaway * np.exp(-(np.linspace(0.0, 5.0, TIMES.size) ** 2)), atol=1e-9)


def test_stribeck_friction_turns_round_as_seal_friction_does():
    presliding = 3e-4
    slow = change({'stribeck_friction': (1.0, 1e3, presliding)})
    np.testing.assert_allclose(slow, change({'seal_friction': (1.0, 0.0, 0.0, presliding)}), atol=1e-6)


def test_one_sample_at_a_time_gives_the_recording():
    effects = {name: FORCE_EFFECTS[name].starts(DATA)[0] for name in FORCE_EFFECTS}
    state = np.empty(FORCE_STATES + 1)
    set_force_to_rest(X[0], state)
    parameters, on = all_force_parameters(effects), force_switches(effects)
    live = [
        step_force(time, x, rate, acceleration, a, b, AMBIENT, AREA, state, parameters, on)
        for time, x, rate, acceleration, a, b in zip(TIMES, X, RATE, ACCELERATION, A, B)
    ]
    assert state[SLID] == X[-1]
    np.testing.assert_array_equal(live, force(effects))
