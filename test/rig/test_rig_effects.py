# SPDX-License-Identifier: Apache-2.0
"""The rig's effects: none by default, each with its signature, and right in its limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import (
    Cylinder,
    Performance,
    Piston,
    Rig,
    RigParameters,
    Seal,
    Truth,
    out_and_back,
    paper_step,
    physics,
    record,
)
from cfd_pneumatic.rig.command import CommandPath
from cfd_pneumatic.rig.effects import Effects, Pickup
from cfd_pneumatic.rig.oddities import Oddities
from cfd_pneumatic.rig.piston import Linkage
from cfd_pneumatic.rig.responses import HeldLag, Response
from cfd_pneumatic.rig.rig import setpoint_disturbance
from cfd_pneumatic.units import PSI

GAUGE = 10 * PSI
REST = AMBIENT_PRESSURE + GAUGE
PERIOD = 2e-4
FROZEN = Cylinder(pressure_dependence=0.0, position_dependence=0.0, control_volume=5e-8, supply_gain_growth=0.0)
SEALED = Cylinder(supply_gain=0.0, relief_gain=0.0, aspirator_diameter=1e-6)

EACH: dict[str, RigParameters] = {
    'leak through a hole': RigParameters(effects_a=Effects(leak_conductance=2e-11)),
    'leak through a gap': RigParameters(effects_a=Effects(leak_admittance=1e-10)),
    'seal that lifts': RigParameters(effects_a=Effects(lift_admittance=5e-10, lift_position=1e-3, lift_direction=1.0)),
    'line restriction': RigParameters(effects_a=Effects(line_resistance=1e7)),
    'dead band': RigParameters(effects_a=Effects(dead_band=1000.0)),
    'play': RigParameters(effects_a=Effects(play=1000.0)),
    'nonlinear valve, steep at first': RigParameters(effects_a=Effects(valve_exponent=0.6)),
    'nonlinear valve, flat at first': RigParameters(effects_a=Effects(valve_exponent=1.7)),
    'poppet inertia': RigParameters(effects_a=Effects(poppet_frequency=40.0)),
    'droop': RigParameters(effects_a=Effects(droop=1e8)),
    'heat transfer': RigParameters(effects_a=Effects(heat_transfer=0.7)),
    'drift': RigParameters(effects_a=Effects(drift=2000.0)),
    'pulsation': RigParameters(effects_a=Effects(pulsation=500.0, pulsation_frequency=8.0)),
    'jump': RigParameters(effects_a=Effects(jump=1000.0, jump_time=0.3)),
    'lost motion': RigParameters(piston=Piston(lost_motion=4e-4)),
    'saturation': RigParameters(cylinder_a=Cylinder(supply_conductance=2e-11)),
}
"""Each effect in the physics, strong."""


def hold(rig: Rig, duration: float, setpoint: float = GAUGE) -> Truth:
    """Leave the piston where it is."""
    knots = round(duration / PERIOD)
    return rig.advance(np.full(knots, rig.position), np.zeros(knots), (setpoint, 5 * PSI), PERIOD)


def sweep(rig: Rig, end: float, duration: float) -> Truth:
    """Move the piston at an even speed."""
    knots = round(duration / PERIOD)
    positions = np.linspace(rig.position, end, knots + 1)[1:]
    return rig.advance(positions, np.full(knots, (end - rig.position) / duration), (GAUGE, 5 * PSI), PERIOD)


def with_effects(cylinder: Cylinder = FROZEN, **strengths: float) -> RigParameters:
    """Return a rig whose cylinder A has some effects."""
    return RigParameters(cylinder_a=cylinder, effects_a=Effects(**strengths))


def resting(setpoint: float = GAUGE, **strengths: float) -> float:
    """Return cylinder A's gauge pressure after a while at rest [Pa]."""
    rig = Rig((setpoint, 5 * PSI), with_effects(**strengths))
    return float(hold(rig, 1.0, setpoint).pressures[-1, 0]) - AMBIENT_PRESSURE


def responses(parameters: RigParameters, longest_step: float = 5e-5) -> np.ndarray:
    """Return cylinder A's pressure along the paper's step [Pa]."""
    schedule = paper_step(GAUGE)
    rig = Rig((GAUGE, 5 * PSI), parameters, longest_step=longest_step)
    return rig.advance(schedule.positions, schedule.velocities, (GAUGE, 5 * PSI), PERIOD).pressures[:, 0]


def test_without_strength_an_effects_form_does_not_matter() -> None:
    """Neutral effects leave the rig as it is to the last bit, whatever their other parameters."""
    schedule = out_and_back(repeats=1)
    forms = Effects(
        lift_position=1e-3,
        lift_width=1e-3,
        lift_end=-1.0,
        lift_direction=1.0,
        outlet_volume=1e-5,
        valve_pivot=1.0,
        poppet_damping=0.9,
        droop_lag=5.0,
        pulsation_frequency=3.0,
        pulsation_phase=1.0,
        jump_time=1.0,
        resonance_damping=0.5,
        hum_frequency=60.0,
        hum_phase=1.0,
    )
    plain, formed = record(schedule), record(schedule, RigParameters(effects_a=forms, effects_b=forms))
    for name in ('times', 'displacement', 'pressures', 'setpoints', 'force'):
        assert np.array_equal(getattr(plain, name), getattr(formed, name)), name


@pytest.mark.parametrize('name', EACH)
def test_a_strong_effect_shows_in_its_cylinder_and_not_in_the_other(name: str) -> None:
    schedule = paper_step(GAUGE)
    plain = record(schedule, RigParameters(cylinder_a=EACH[name].cylinder_a._replace(supply_conductance=3.1e-8)))
    there = record(schedule, EACH[name])
    difference = there.truth.pressures - plain.truth.pressures
    assert np.max(np.abs(difference[:, 0])) > 150.0, 'three times the noise'
    if name != 'lost motion':
        assert np.all(difference[:, 1] == 0.0)


@pytest.mark.parametrize('name', EACH)
def test_the_integration_converges_with_each_effect(name: str) -> None:
    """At the default length a step is within a tenth of the sensor's noise of a much shorter one."""
    exact = responses(EACH[name], 5e-6)
    errors = [np.max(np.abs(responses(EACH[name], step) - exact)) for step in (1e-4, 5e-5)]
    assert errors[1] < 5.0
    assert errors[1] <= errors[0] * 1.05 + 1e-6


def test_played_in_pieces_with_effects() -> None:
    effects = Effects(
        resonance_frequency=80.0,
        sensor_lag=3e-3,
        hum=50.0,
        play=300.0,
        drift=100.0,
        command_dead_time=0.0203,
        command_lag=0.015,
    )
    parameters = RigParameters(
        effects_a=effects, piston=Piston(lost_motion=1e-4), pickup=Pickup(displacement_lag=4e-3, force_offset=1.0)
    )
    schedule = out_and_back(repeats=1)
    whole = record(schedule, parameters, seed=3)
    performance = Performance(schedule, parameters, seed=3)
    parts = [performance.advance(piece) for piece in (1, 7, 500, 300)]
    parts.append(performance.advance(performance.remaining))
    for name in ('displacement', 'pressures', 'force'):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name)), name


# leaks


def test_a_laminar_leak_lowers_the_resting_pressure_in_proportion() -> None:
    deficits = [1.0 - resting(gauge, leak_admittance=5e-11) / gauge for gauge in (5 * PSI, 10 * PSI, 20 * PSI)]
    assert deficits[0] > 0.001
    assert deficits == pytest.approx([deficits[0]] * 3, rel=0.01)


def test_a_holes_leak_grows_more_slowly_until_it_is_choked() -> None:
    deficits = [gauge - resting(gauge, leak_conductance=1e-11) for gauge in (5 * PSI, 10 * PSI, 20 * PSI)]
    assert deficits[0] > 50.0
    assert 1.0 < deficits[1] / deficits[0] < 2.0
    flow = physics.leak_flow(4e5, 0.0, 0.0, Effects(leak_conductance=1e-11), RigParameters().air)
    assert flow == pytest.approx(1e-11 * 4e5 * physics.REFERENCE_DENSITY), 'choked'


@given(st.floats(-6e-3, 6e-3), st.floats(-0.5, 0.5), st.sampled_from([-1.0, 1.0]), st.sampled_from([-1.0, 0.0, 1.0]))
def test_a_seal_lifts_at_its_end_and_in_its_direction(x: float, v: float, end: float, direction: float) -> None:
    effects = Effects(lift_position=1e-3 * end, lift_width=1e-4, lift_end=end, lift_direction=direction)
    lift = physics.seal_lift(x, v, effects)
    assert 0.0 <= lift <= 1.0
    if end * x < 0.5e-3 or direction * v < -0.03:
        assert lift < 1e-3
    if end * x > 1.5e-3 and (direction == 0.0 or direction * v > 0.03):
        assert lift > 0.999


# valve and regulator


@given(st.lists(st.floats(-5e3, 5e3), min_size=1, max_size=20), st.floats(0.0, 2e3))
def test_play_follows_within_its_width_and_moves_only_when_pushed(targets: list[float], half_width: float) -> None:
    held = 0.0
    for target in targets:
        moved = physics.backlash(held, target, half_width)
        assert abs(moved - target) <= half_width * (1.0 + 1e-12) + 1e-9
        if abs(held - target) <= half_width:
            assert moved == held
        held = moved


@given(st.floats(-1e4, 1e4), st.floats(0.0, 1e3), st.floats(0.4, 2.5))
def test_a_valves_characteristic_is_odd_and_rises(error: float, band: float, exponent: float) -> None:
    effects = Effects(dead_band=band, valve_exponent=exponent)
    opened = physics.valve_characteristic(error, effects)
    assert physics.valve_characteristic(-error, effects) == -opened
    assert physics.valve_characteristic(error + 10.0, effects) >= opened
    pivoted = physics.valve_characteristic(effects.valve_pivot + band, effects)
    assert pivoted == pytest.approx(effects.valve_pivot), 'the pivot is the same for each exponent'
    if abs(error) <= band:
        assert opened == 0.0


def test_within_a_dead_band_an_offset_stays() -> None:
    """A set-point that moves by less than the band moves nothing; beyond it, the band is what is left."""
    for rise, left in ((300.0, 300.0), (3000.0, 500.0), (-3000.0, -500.0)):
        rig = Rig((GAUGE, 5 * PSI), with_effects(dead_band=500.0))
        pressure = hold(rig, 1.5, GAUGE + rise).pressures[-1, 0]
        assert REST + rise - pressure == pytest.approx(left, abs=1.0)


def test_play_leaves_another_pressure_from_above_than_from_below() -> None:
    rests = []
    for rise in (-3000.0, 3000.0):
        rig = Rig((GAUGE, 5 * PSI), with_effects(play=500.0))
        hold(rig, 1.0, GAUGE - rise)
        rests.append(float(hold(rig, 2.0).pressures[-1, 0]) - REST)
    assert rests == pytest.approx([-500.0, 500.0], abs=1.0), 'the valve closes late'


def test_a_saturated_valve_fills_at_its_rate() -> None:
    limited = FROZEN._replace(supply_conductance=1e-11)
    rig = Rig((GAUGE, 5 * PSI), RigParameters(cylinder_a=limited))
    rates = np.diff(hold(rig, 0.02, 20 * PSI).pressures[:, 0]) / PERIOD
    air = RigParameters().air
    inflow = 1e-11 * air.supply_pressure * physics.REFERENCE_DENSITY
    expected = limited.polytropic_exponent / limited.rest_volume * air.gas_constant * air.temperature * inflow
    assert rates[5:] == pytest.approx(expected, rel=0.01)


def test_droop_comes_with_flow_and_goes_after_it() -> None:
    plain, drooping = (Rig((5 * PSI, 5 * PSI), with_effects(droop=strength)) for strength in (0.0, 5e7))
    slower = hold(drooping, 1.0).pressures[:, 0]
    faster = hold(plain, 1.0).pressures[:, 0]
    assert np.max(faster - slower) > 1000.0
    assert slower[-1] == pytest.approx(faster[-1], abs=5.0)


def test_a_quick_poppet_is_none_and_a_slow_one_rings() -> None:
    plain = responses(with_effects())
    assert responses(with_effects(poppet_frequency=2000.0, poppet_damping=0.7)) == pytest.approx(plain, abs=50.0)
    slow = responses(with_effects(poppet_frequency=25.0))
    assert np.max(plain) - REST < 1.0
    assert np.max(slow) - REST > 1000.0
    assert slow[-1] == pytest.approx(REST, abs=1.0)


def test_the_set_pressure_drifts_pulsates_and_jumps() -> None:
    times = np.array([0.0, 0.25, 1.0, 2.0])
    assert setpoint_disturbance(times, Effects(drift=3.0), Oddities()).tolist() == [0.0, 0.75, 3.0, 6.0]
    assert setpoint_disturbance(times, Effects(pulsation=2.0), Oddities()) == pytest.approx([0.0, 2.0, 0.0, 0.0])
    assert setpoint_disturbance(times, Effects(jump=5.0, jump_time=1.0), Oddities()).tolist() == [0.0, 0.0, 5.0, 5.0]
    rig = Rig((GAUGE, 5 * PSI), with_effects(jump=1000.0, jump_time=0.5))
    truth = hold(rig, 1.0)
    assert truth.pressures[[2400, -1], 0] == pytest.approx([REST, REST + 1000.0], abs=1.0)
    assert np.all(truth.setpoints[:, 0] == REST), 'nobody set it'


# line and heat


def test_air_in_a_restricted_line_passes_with_its_time_constant() -> None:
    """Sealed but for the line, cylinder and outlet volume even out what a stroke has upset, and lose nothing."""
    cylinder = SEALED._replace(polytropic_exponent=1.0)
    effects = Effects(line_resistance=2e7, outlet_volume=1e-5)
    rig = Rig((GAUGE, 5 * PSI), RigParameters(cylinder_a=cylinder, effects_a=effects))
    sweep(rig, -1e-3, 0.001)
    after = hold(rig, 0.2).pressures[:, 0]
    volume = cylinder.rest_volume - 1e-3 * cylinder.area
    whole = cylinder.rest_volume + effects.outlet_volume
    assert after[-1] == pytest.approx(REST * whole / (volume + effects.outlet_volume), rel=1e-4)
    heat = RigParameters().air.gas_constant * RigParameters().air.temperature
    constant = effects.line_resistance / heat / (1.0 / volume + 1.0 / effects.outlet_volume)
    excess = after - after[-1]
    elapsed = np.log(excess[20] / excess[70]) * constant
    assert elapsed == pytest.approx(50 * PERIOD, rel=0.02)


@pytest.mark.parametrize(('heat_transfer', 'exponent'), [(1e-6, 1.4), (300.0, 1.0)])
def test_a_sealed_cylinder_is_adiabatic_or_isothermal(heat_transfer: float, exponent: float) -> None:
    rig = Rig((GAUGE, 5 * PSI), with_effects(SEALED, heat_transfer=heat_transfer))
    truth = sweep(rig, -4e-3, 0.05)
    invariant = truth.pressures[:, 0] * (SEALED.rest_volume + SEALED.area * truth.displacement) ** exponent
    assert invariant == pytest.approx(REST * SEALED.rest_volume**exponent, rel=2e-3)


def test_compressed_air_cools_to_the_wall() -> None:
    """After a quick stroke the pressure falls back to the isothermal one, with the time constant m c_v / (h A)."""
    conductance = 0.5
    rig = Rig((GAUGE, 5 * PSI), with_effects(SEALED, heat_transfer=conductance))
    sweep(rig, -1e-3, 0.001)
    after = hold(rig, 2.0).pressures[:, 0]
    isothermal = REST * SEALED.rest_volume / (SEALED.rest_volume - 1e-3 * SEALED.area)
    assert after[-1] == pytest.approx(isothermal, rel=1e-5)
    air = RigParameters().air
    mass = REST * SEALED.rest_volume / (air.gas_constant * air.temperature)
    time_constant = mass * (air.gas_constant / 0.4) / conductance
    excess = after - isothermal
    assert np.log(excess[100] / excess[600]) == pytest.approx(500 * PERIOD / time_constant, rel=0.01)


# what lies before the sensors


def test_a_lag_follows_a_ramp_at_its_distance() -> None:
    times = PERIOD * np.arange(1.0, 2001.0)
    read = Response.lag(5e-3, 0.0).respond(times, PERIOD)
    assert read == pytest.approx(times - 5e-3 * (1.0 - np.exp(-times / 5e-3)), abs=1e-12)


@pytest.mark.parametrize('frequency', [40.0, 95.0, 200.0])
def test_a_line_rings_at_its_frequency(frequency: float) -> None:
    times = PERIOD * np.arange(1.0, 1001.0)
    step = np.full(1000, 1.0)
    read = Response.resonance(frequency, 0.1, 0.0).respond(step, PERIOD)
    omega, damped = 2.0 * np.pi * frequency, 2.0 * np.pi * frequency * np.sqrt(1.0 - 0.01)
    rising = times - 0.5 * PERIOD  # the input runs straight up to its first value
    expected = 1.0 - np.exp(-0.1 * omega * rising) * (
        np.cos(damped * rising) + 0.1 * omega / damped * np.sin(damped * rising)
    )
    assert read == pytest.approx(expected, abs=5e-3)
    assert read[-1] == pytest.approx(1.0, abs=0.1)


def test_the_mains_are_in_the_signal_only() -> None:
    run = record(paper_step(), with_effects(hum=300.0, hum_frequency=50.0, hum_phase=1.0))
    plain = record(paper_step(), with_effects())
    assert np.array_equal(run.truth.pressures, plain.truth.pressures)
    difference = run.pressures[:, 0] - plain.pressures[:, 0]
    assert np.max(np.abs(difference - 300.0 * np.sin(2 * np.pi * 50.0 * run.truth.times + 1.0))) < 60.0


def test_a_displacement_sensor_that_lags() -> None:
    lagging = RigParameters(pickup=Pickup(displacement_lag=5e-3))
    run, plain = record(paper_step(), lagging), record(paper_step())
    late = plain.truth.displacement - run.displacement
    assert np.max(late) > 0.4e-3
    assert late[-100:] == pytest.approx(0.0, abs=1e-5)
    assert np.array_equal(run.pressures, plain.pressures)


def test_a_displacement_sensor_that_is_late() -> None:
    late = RigParameters(pickup=Pickup(displacement_delay=20.5e-3))
    run, plain = record(paper_step(), late), record(paper_step())
    then = np.interp(plain.truth.times - 20.5e-3, plain.truth.times, plain.truth.displacement)
    assert run.displacement == pytest.approx(then, abs=6e-5)  # it bends between samples
    assert np.max(np.abs(run.displacement - plain.displacement)) > 1e-3
    assert np.array_equal(run.pressures, plain.pressures)


# the path of a command


def stepped(steps: int = 3, **strengths: float) -> Truth:
    """Let the set pressure of A step every 0.2 s with the piston at rest."""
    rig = Rig((GAUGE, 5 * PSI), with_effects(**strengths))
    knots = steps * 1000
    levels = GAUGE + 2 * PSI * (np.arange(knots) // 1000 % 2 == 0)
    return rig.advance(np.zeros(knots), np.zeros(knots), np.column_stack([levels, np.full(knots, 5 * PSI)]), PERIOD)


@pytest.mark.parametrize('dead_time', [0.0004, 0.01507, 0.06])
def test_a_command_arrives_after_its_dead_time(dead_time: float) -> None:
    plain, late = stepped(), stepped(command_dead_time=dead_time)
    then = np.interp(plain.times - dead_time, np.append(0.0, plain.times), np.append(REST, plain.pressures[:, 0]))
    assert late.pressures[:, 0] == pytest.approx(then, abs=40.0)
    assert np.max(np.abs(np.diff(plain.pressures[:, 0]))) > 150.0, 'from knot to knot, so that 40 Pa are 60 us'
    assert np.array_equal(late.setpoints, plain.setpoints), 'as commanded'
    assert np.array_equal(late.pressures[:, 1], plain.pressures[:, 1])


def test_a_command_that_lags_arrives_by_parts() -> None:
    """In the mean it is as late as a dead time, which is what the area between two pressures shows."""
    plain, lagging, late = stepped(1), stepped(1, command_lag=0.02), stepped(1, command_dead_time=0.02)
    lost = [PERIOD * np.sum(plain.pressures[:, 0] - other.pressures[:, 0]) for other in (lagging, late)]
    assert lost == pytest.approx([0.02 * 2 * PSI] * 2, rel=0.05)
    assert np.max(np.abs(lagging.pressures[:, 0] - late.pressures[:, 0])) > 500.0
    assert np.array_equal(lagging.setpoints, plain.setpoints)
    assert np.array_equal(lagging.pressures[:, 1], plain.pressures[:, 1])


def test_the_path_of_a_command_changes_at_the_last_command() -> None:
    path, healthy, late = CommandPath(1.0), Effects(), Effects(command_dead_time=0.003, command_lag=1e-9)
    assert path.carry(np.array([1.0, 2.0]), 1e-3, healthy).tolist() == [1.0, 2.0]
    assert path.carry(np.array([3.0, 3.0]), 1e-3, late) == pytest.approx([2.0, 2.0])
    assert path.carry(np.array([4.0, 4.0]), 1e-3, late) == pytest.approx([2.0, 3.0], abs=1e-5)
    assert path.carry(np.array([5.0, 5.0]), 1e-3, healthy).tolist() == [5.0, 5.0]
    assert path.carry(np.array([6.0]), 1e-3, late) == pytest.approx([5.0]), 'what was under way is forgotten'


@given(st.floats(1e-4, 1.0), st.floats(1e-4, 0.1), st.integers(1, 30))
def test_a_held_lag_is_exact(time_constant: float, period: float, cut: int) -> None:
    inputs = np.repeat([1.0, -2.0, 5.0], 10)
    lag = HeldLag(time_constant, 1.0)
    means = np.concatenate([lag.respond(part, period) for part in (inputs[:cut], inputs[cut:])])
    assert means[:10] == pytest.approx(np.ones(10))
    ends = period * np.arange(1, 11)
    integral = 3.0 * time_constant * -np.expm1(-ends / time_constant) - 2.0 * ends
    assert period * np.cumsum(means[10:20]) == pytest.approx(integral, abs=1e-9)


# mechanics


@given(st.lists(st.floats(-3e-3, 3e-3), min_size=1, max_size=30), st.floats(1e-6, 1e-3))
def test_a_piston_hangs_on_its_tool(positions: list[float], gap: float) -> None:
    tool = np.array(positions)
    x, v = Linkage(0.0, gap).drive(tool, np.ones(len(tool)))
    assert x[0] == v[0] == 0.0
    assert np.max(np.abs(x[1:] - tool)) <= 0.5 * gap * (1 + 1e-9)
    assert np.all((np.diff(x) == 0.0) == (v[1:] == 0.0))


def test_within_the_gap_nothing_moves() -> None:
    rig = Rig((GAUGE, 5 * PSI), RigParameters(piston=Piston(lost_motion=2e-4)))
    assert np.all(sweep(rig, 0.9e-4, 0.01).pressures[:, 0] == REST)
    assert np.min(sweep(rig, 5e-4, 0.01).pressures[:, 0]) < REST - 300.0


def test_the_load_cell_has_an_offset_and_carries_the_mass() -> None:
    still = Seal(coulomb=0.0, coulomb_per_pressure=0.0, viscous=0.0)
    light = RigParameters(piston=Piston(mass=0.0), seal=still)
    heavy = light._replace(piston=Piston(mass=0.3, inclination=np.radians(30.0)), pickup=Pickup(force_offset=2.0))
    schedule = out_and_back(repeats=1)
    one, other = record(schedule, light), record(schedule, heavy)
    expected = 2.0 - 0.3 * (9.80665 * 0.5 + one.truth.acceleration)
    within = np.abs(one.truth.acceleration) < 200.0
    assert (other.force - one.force)[within] == pytest.approx(expected[within], abs=0.1)


def test_effects_that_cannot_be_are_refused() -> None:
    for bad, name in (({'play': -1.0}, 'effects_a.play'), ({'lift_width': 0.0}, 'effects_a.lift_width')):
        with pytest.raises(InputError, match=name):
            Rig((0.0, 0.0), with_effects(**bad))
    Rig((0.0, 0.0), with_effects(drift=-1.0, jump=-3.0))
