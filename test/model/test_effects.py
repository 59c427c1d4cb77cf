# SPDX-License-Identifier: Apache-2.0
"""Each effect: null is the baseline, strong it shows as physics has it, and the composed kernel is up to date."""

import ast
import math
import re
from pathlib import Path

import numpy as np
import pytest
from effect_cases import DATA
from reference import AMBIENT, PSI

from cfd_pneumatic.generator.composition import composed_source
from cfd_pneumatic.model import TABLE_1, Cylinder, ExtendedCylinder, Movement, OperatingPoints, SideBySide
from cfd_pneumatic.model import composed as kernel
from cfd_pneumatic.model.effects import EFFECTS, PRESSURE_EFFECTS, Moment, heat_transfer, leakage, positional_leakage
from cfd_pneumatic.model.places import FORCE_PLACES, PLACES, all_parameters

GAINS = TABLE_1.table[0, 1:]
TIMES = np.arange(700) * 0.002
STROKE = np.interp(TIMES, [0.1, 0.11, 0.7, 0.71], [0.0, 1.5e-3, 1.5e-3, 0.0])
RANGES = ((AMBIENT, 2e5), (0.0, 1.5e-3), 0.1)
SETPOINT = np.full(TIMES.size, AMBIENT + 5.0 * PSI)


STILL = np.zeros(TIMES.size)


def simulate(effects, stroke=STROKE, gains=GAINS, setpoint=SETPOINT):
    return ExtendedCylinder(gains, effects, AMBIENT).simulate(TIMES, stroke, setpoint)


def change(effects):
    """Return what effects change in the pressure [Pa]."""
    return simulate(effects) - simulate({})


def test_without_effects_it_is_the_papers_model():
    exact = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT).simulate(TIMES, STROKE, SETPOINT)
    np.testing.assert_allclose(simulate({}), exact, atol=1e-7 * PSI * 1e3)


@pytest.mark.parametrize('name', PRESSURE_EFFECTS)
def test_at_its_null_value_an_effect_is_absent(name):
    null = {name: EFFECTS[name].null}
    assert ExtendedCylinder(GAINS, null, AMBIENT).stiffness(*RANGES) == ExtendedCylinder(GAINS, {}, AMBIENT).stiffness(
        *RANGES
    )
    # without a loss of heat the air that leaves is still warmer than what the gains were identified with
    tolerance = 30.0 if name == 'heat_transfer' else 1e-9
    np.testing.assert_allclose(simulate(null), simulate({}), rtol=0.0, atol=tolerance)


@pytest.mark.parametrize('name', [name for name, effect in PRESSURE_EFFECTS.items() if effect.rests_at_pressure])
def test_a_state_that_is_a_pressure_rests_at_the_set_point(name):
    for own in EFFECTS[name].starts(DATA):
        np.testing.assert_allclose(simulate({name: own}, stroke=STILL), SETPOINT, rtol=0.0, atol=1e-6)
    states = ExtendedCylinder(GAINS, {name: own}, AMBIENT).begin(1.5e5, 1.5e5, 0.0).values
    assert states[PLACES[name].states.start] == 1.5e5


@pytest.mark.parametrize('name', EFFECTS)
def test_every_effect_says_what_it_is(name):
    effect = EFFECTS[name]
    assert effect.name == name
    assert effect.description
    words = set(re.findall(r'\w+', ' '.join(effect.equations)))
    assert [one.name for one in effect.parameters if one.name not in words] == []
    for parameter in effect.parameters:
        assert parameter.lower <= parameter.null <= parameter.upper
        assert parameter.unit
        assert parameter.description


@pytest.mark.parametrize('name', EFFECTS)
def test_every_effect_says_what_to_record_to_see_it(name):
    """As one of a list of things, so without a beginning or an end of a sentence."""
    shown_by = EFFECTS[name].shown_by
    assert shown_by
    assert shown_by[0].islower()
    assert not shown_by.endswith('.')
    assert ';' not in shown_by


def test_places_do_not_overlap():
    for kind in ('parameters', 'states'):
        for places in (PLACES, FORCE_PLACES):
            own = [getattr(place, kind) for place in places.values()]
            taken = [index for indices in own for index in range(indices.start, indices.stop)]
            assert len(taken) == len(set(taken))


def test_the_composed_kernel_is_up_to_date():
    """`make kernel` makes it."""
    assert ast.dump(ast.parse(composed_source())) == ast.dump(ast.parse(Path(kernel.__file__).read_text()))


def test_a_leak_lowers_the_resting_pressure():
    """At rest K_sv (p_d - p) makes up for what leaks."""
    conductance = 0.5
    gauge = SETPOINT[0] - AMBIENT
    expected = -conductance * gauge / (GAINS[1] + conductance)
    assert change({'leakage': (conductance, 0.0)})[300] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ('p', 'ambient', 'lost'),
    [
        (3e5, 1e5, 6e5),  # 2/s times 3 bar: choked, whatever is downstream
        (3e5, 1.5e5, 6e5),
        (1.25e5, 1e5, 204_315.0),  # (0.8 - 0.528) / 0.472 = 0.57627; (1 - 0.57627^2)^0.5 = 0.81726; times 2.5e5
        (1e5, 1e5, 0.0),
        (0.9e5, 1e5, 0.0),
    ],
)
def test_through_a_hole_it_is_the_flow_of_an_orifice(p, ambient, lost):
    moment = Moment(0.0, 0.0, 0.0, p, p, ambient)
    assert leakage.chamber(7.0, moment, 2.0, 1.0) == pytest.approx(7.0 - lost, abs=1.0)


def test_a_choked_leak_lowers_the_resting_pressure_by_its_share_of_it():
    """K_sv (p_d - p) = 2 p, with K_sv = 104.32285: p = 104.32285 / 106.32285 p_d."""
    leaking = simulate({'leakage': (2.0, 1.0)}, stroke=STILL, setpoint=np.full(TIMES.size, 3e5))
    assert leaking[-1] == pytest.approx(294_356.8, abs=0.2)


def test_a_positional_leak_shows_only_at_its_end():
    dropped = change({'positional_leakage': (0.5, 1e-3, 2e-4, 0.01, 1.0, 0.0)})
    assert abs(dropped[45]) < 0.05, 'five widths before'
    assert dropped[300] < -50.0


def test_a_seal_that_lifts_in_one_direction_lifts_with_the_speed():
    """At the lifting speed 88 % of the gauge pressure's share leaks: (1 + tanh 1) / 2."""
    shares = []
    for rate in (-0.2, 0.0, 0.01, 0.2):
        moment = Moment(0.0, 0.5, rate, AMBIENT + 1e4, AMBIENT + 1e4, AMBIENT)
        shares.append(-positional_leakage.chamber(0.0, moment, 1.0, 0.0, 1e-3, 0.01, 1.0, 1.0) / 1e4)
    assert shares == pytest.approx([0.0, 0.5, 0.5 + 0.5 * math.tanh(1.0), 1.0], abs=1e-9)


def test_a_dead_band_leaves_an_offset_of_its_width():
    final = simulate({'valve_dead_band': (300.0,)})[340] - SETPOINT[0]
    assert abs(final) == pytest.approx(300.0, rel=0.05)


def test_hysteresis_keeps_the_valve_open_past_zero_error():
    assert np.ptp(change({'valve_hysteresis': (200.0,)})) > 200.0


def test_saturation_binds_only_beyond_its_limit():
    largest = GAINS[1] * np.max(SETPOINT - simulate({}))
    assert np.max(np.abs(change({'flow_saturation': (1.5 * largest, 1e9)}))) < 1e-6
    assert np.min(change({'flow_saturation': (0.3 * largest, 1e9)})) < -100.0


def test_a_sensor_lag_is_a_first_order_lag():
    lag = 0.01
    p = simulate({})
    fine = np.interp(np.arange(0.0, TIMES[-1], 1e-5), TIMES, p)
    reading = np.empty_like(fine)
    reading[0] = fine[0]
    for i in range(1, fine.size):
        reading[i] = reading[i - 1] + 1e-5 / lag * (fine[i - 1] - reading[i - 1])
    expected = np.interp(TIMES[:-1], np.arange(0.0, TIMES[-1], 1e-5), reading)
    np.testing.assert_allclose(simulate({'sensor_lag': (lag,)})[:-1], expected, atol=15.0)


@pytest.mark.parametrize('duration', [1e-4, 0.002, 0.05, 1.0])
@pytest.mark.parametrize('lag', [5e-4, 0.02, 0.3])
def test_a_set_point_that_lags_is_exact_after_a_step_of_any_size(lag, duration):
    cylinder = ExtendedCylinder(GAINS, {'setpoint_lag': (lag,)}, AMBIENT)
    rest = cylinder.begin(SETPOINT[0], SETPOINT[0], 0.0)
    after = cylinder.step(rest, Movement(duration, duration, 0.0, 0.0), SETPOINT[0] + 1e4)
    acting = after.values[PLACES['setpoint_lag'].states.start]
    assert acting - SETPOINT[0] == pytest.approx(-1e4 * math.expm1(-duration / lag), rel=1e-9)


@pytest.mark.parametrize('lag', [0.004, 0.03])
def test_the_pressure_follows_the_set_point_that_lags(lag):
    """Against the paper's model, exactly integrated in steps in which the lagging set-point is nearly constant."""
    commanded = SETPOINT + 1e4 * (TIMES > 0.2)
    parts = 100
    fine = np.arange(TIMES.size * parts - parts + 1) * 0.002 / parts
    passed = np.maximum(fine - 0.5 * 0.002 / parts - 0.2, 0.0)
    acting = SETPOINT[0] - 1e4 * np.expm1(-passed / lag)
    stroke = np.interp(fine, TIMES, STROKE)
    exact = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT).simulate(fine, stroke, acting)[::parts]
    np.testing.assert_allclose(simulate({'setpoint_lag': (lag,)}, setpoint=commanded), exact, rtol=0.0, atol=12.0)


def test_the_acting_set_point_rests_at_the_command_whatever_the_pressure():
    resting = SideBySide(
        ExtendedCylinder(GAINS, {'setpoint_lag': (0.03,)}, AMBIENT),
        all_parameters(GAINS, {'setpoint_lag': (0.03,)})[None],
        np.array([150.0]),
        np.array([-2e4]),
        0.0,
        1e3,
    )
    plain = SideBySide(
        ExtendedCylinder(GAINS, {}, AMBIENT),
        all_parameters(GAINS, {})[None],
        np.array([150.0]),
        np.array([-2e4]),
        0.0,
        1e3,
    )
    lagging, prompt = (cylinder.simulate_piece(TIMES, STROKE, SETPOINT) for cylinder in (resting, plain))
    assert prompt[0, 0] == SETPOINT[0] + 150.0 - 2e4
    np.testing.assert_allclose(lagging, prompt, rtol=0.0, atol=1e-6)


def test_a_resonance_rings_at_its_frequency():
    ringing = change({'line_resonance': (60.0, 0.05)})[55:300]
    spectrum = np.abs(np.fft.rfft(ringing * np.hanning(ringing.size)))
    assert np.fft.rfftfreq(ringing.size, 0.002)[np.argmax(spectrum)] == pytest.approx(60.0, abs=4.0)


def test_lost_motion_swallows_small_strokes():
    small = 0.1 * STROKE
    moved = simulate({'lost_motion': (2e-4,)}, stroke=small) - SETPOINT
    assert np.max(np.abs(moved)) < 1e-6


def test_the_volume_scales_all_gains():
    """At twice the volume the chamber is as one with half of K_x, K_sv and K_v."""
    slope = 1.0 / 1.5e-3
    far = simulate({'volume_variation': (slope,)}, stroke=STROKE + 1.5e-3)
    halved = GAINS * [0.5, 0.5, 0.5, 1.0]
    assert np.min(far) > np.min(simulate({})) + 500.0
    assert np.min(far) == pytest.approx(np.min(simulate({}, gains=halved)), abs=700.0)


def test_heat_transfer_takes_a_fast_change_to_isothermal():
    """Without flow an adiabatic change of 1.4 parts relaxes to 1."""
    closed = np.array([GAINS[0], 1e-3, 1e-3, GAINS[3]])
    p = simulate({'heat_transfer': (20.0,)}, gains=closed) - SETPOINT
    assert p[300] / p[55] == pytest.approx(1.0 / 1.4, rel=0.1)


def test_warm_air_that_leaves_takes_more_pressure_along():
    """The wall is a tenth colder than the air: the air is a ninth warmer than the wall."""
    moment = Moment(0.0, 0.0, 0.0, 2e5, 2e5, AMBIENT)
    assert heat_transfer.flow(-1000.0, moment, 2e4, 5.0) == pytest.approx(-1000.0 / 0.9)
    assert heat_transfer.flow(1000.0, moment, 2e4, 5.0) == 1000.0


def test_much_air_cools_slowly():
    """Twice the mass of air: half the rate at which it loses what is due to temperature."""
    once, twice = (heat_transfer.cooling(Moment(0.0, 0.0, 0.0, p, p, AMBIENT), 1e3, 5.0) for p in (1.01e5, 2.01e5))
    assert once == pytest.approx(5.0 * 1e3 * AMBIENT / 1e5)
    assert twice == pytest.approx(0.5 * once)


def test_a_drift_is_followed():
    assert change({'set_point_drift': (100.0,)})[-1] == pytest.approx(100.0 * TIMES[-1], rel=0.1)


def test_restriction_makes_the_regulator_stop_early():
    p = simulate({'line_restriction': (0.05, 0.05)})
    assert np.min(p) < np.min(simulate({}))


def test_through_a_line_without_volume_the_regulator_senses_the_drop():
    """With no outlet to fill, what the valves let pass goes through the line: p + R times the flow is sensed."""
    k_x, k_sv, k_v, tau = GAINS
    resistance, fine = 0.05, 40
    p = p_f = SETPOINT[0]
    expected = [p]
    for i in range(1, TIMES.size):
        h = (TIMES[i] - TIMES[i - 1]) / fine
        velocity = (STROKE[i] - STROKE[i - 1]) / (TIMES[i] - TIMES[i - 1])
        for _ in range(fine):
            middle_p, middle_p_f = p, p_f
            for part in (0.5, 1.0):  # the midpoint rule
                error = SETPOINT[0] - middle_p_f
                flow = (k_sv if error > 0.0 else k_v) * error
                middle_p, middle_p_f = (
                    p + part * h * (flow - k_x * velocity),
                    p_f + part * h * (middle_p + resistance * flow - middle_p_f) / tau,
                )
            p, p_f = middle_p, middle_p_f
        expected.append(p)
    restricted = simulate({'line_restriction': (resistance, 1e-3)})
    assert np.max(np.abs(np.array(expected) - simulate({}))) > 1000.0
    # 5 ms (the resistance) are large against the 0.3 ms in which the outlet fills
    np.testing.assert_allclose(restricted, expected, rtol=0.0, atol=25.0)


def test_droop_sags_and_recovers():
    sagging = change({'droop': (0.05, 0.2)})
    assert np.min(sagging[50:150]) < -20.0


def test_a_displacement_that_lagged_is_brought_forward():
    """The piston runs ahead of a lagging reading, so that the pressure falls earlier and farther."""
    assert np.min(simulate({'displacement_lag': (0.005,)})) < np.min(simulate({}))


def test_a_valve_below_power_one_is_stiffer_for_small_errors():
    late = slice(200, 340)
    assert np.max(np.abs((simulate({'nonlinear_valve': (0.6,)}) - SETPOINT)[late])) < np.max(
        np.abs((simulate({}) - SETPOINT)[late])
    )


def test_gains_follow_the_operating_point():
    from cfd_pneumatic.model.effects.operating_point import REFERENCE

    ratio = SETPOINT[0] / REFERENCE
    scaled = GAINS * [ratio, 1.0, ratio, 1.0 / ratio]
    whole = simulate({'operating_point': (1.0, 5e6, 1.0)})
    assert np.max(np.abs(whole - simulate({}, gains=scaled))) < 0.1 * np.ptp(whole)


@pytest.mark.parametrize(
    ('name', 'values', 'expected'),
    [
        ('transport_delay', (-0.02,), True),
        ('transport_delay', (0.01,), False),
        ('displacement_lag', (0.0,), False),
        ('positional_leakage', (0.1, 1e-3, 2e-3, 0.5, 1.0, -1.0), False),
    ],
)
def test_a_search_ends_at_a_bound_where_the_effect_does_something(name, values, expected):
    """Which end leaks, and which way it opens, is a choice and no bound."""
    assert EFFECTS[name].ends_at_bound(values) == expected
