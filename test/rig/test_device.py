# SPDX-License-Identifier: Apache-2.0
"""The rig as a whole: rest, conservation of mass, limits of compression, accuracy, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import Air, Cylinder, Rig, RigParameters, Seal, Truth, paper_step
from cfd_pneumatic.rig.parameters import checked
from cfd_pneumatic.units import PSI

SEALED = {'supply_gain': 0.0, 'relief_gain': 0.0}
PERIOD = 1e-3


def with_cylinders(**changes: float) -> RigParameters:
    """Return the default rig with both cylinders changed alike."""
    return RigParameters(cylinder_a=Cylinder(**changes), cylinder_b=Cylinder(**changes))


def sweep(rig: Rig, end: float, duration: float, setpoints: tuple[float, float] = (5 * PSI, 5 * PSI)) -> Truth:
    """Move the piston at an even speed."""
    knots = round(duration / PERIOD)
    positions = np.linspace(rig.position, end, knots + 1)[1:]
    return rig.advance(positions, np.full(knots, (end - rig.position) / duration), setpoints, PERIOD)


def hold(rig: Rig, duration: float, setpoints: tuple[float, float]) -> Truth:
    """Leave the piston where it is."""
    knots = round(duration / PERIOD)
    return rig.advance(np.full(knots, rig.position), np.zeros(knots), setpoints, PERIOD)


@given(st.floats(1e4, 2e5), st.floats(1e4, 2e5), st.floats(-5e-3, 5e-3))
@settings(max_examples=settings.default.max_examples // 4)
def test_at_rest_the_rig_stays_at_its_set_points(level_a: float, level_b: float, position: float) -> None:
    truth = hold(Rig((level_a, level_b), position=position), 0.1, (level_a, level_b))
    assert np.all(truth.pressures == AMBIENT_PRESSURE + np.array([level_a, level_b]))
    assert truth.force == pytest.approx((level_a - level_b) * Cylinder().area)


def test_set_points_are_reached_from_below_and_above() -> None:
    rig = Rig((5 * PSI, 20 * PSI))
    hold(rig, 1.0, (20 * PSI, 5 * PSI))
    assert rig.pressures - AMBIENT_PRESSURE == pytest.approx([20 * PSI, 5 * PSI], rel=1e-3)


def test_a_growing_volume_lowers_a_and_raises_b() -> None:
    truth = sweep(Rig((5 * PSI, 5 * PSI)), 1.5e-3, 0.01)
    assert truth.pressures[-1, 0] < AMBIENT_PRESSURE + 5 * PSI < truth.pressures[-1, 1]


@pytest.mark.parametrize('exponent', [1.0, 1.4])
def test_a_sealed_cylinder_is_compressed_along_its_polytrope(exponent: float) -> None:
    """P V^n stays: 1 isothermal, 1.4 adiabatic. The control chamber is out of reach through a very thin tube."""
    parameters = with_cylinders(polytropic_exponent=exponent, aspirator_diameter=1e-6, **SEALED)
    rig = Rig((5 * PSI, 5 * PSI), parameters)
    truth = sweep(rig, 5e-3, 0.05)
    for cylinder, direction in enumerate((1.0, -1.0)):
        volumes = Cylinder().rest_volume + direction * Cylinder().area * truth.displacement
        invariant = truth.pressures[:, cylinder] * volumes**exponent
        assert invariant == pytest.approx((AMBIENT_PRESSURE + 5 * PSI) * Cylinder().rest_volume ** exponent, rel=1e-8)


def test_mass_is_conserved_between_sealed_chambers() -> None:
    """Isothermally, mass is pressure times volume; what the cylinder loses the control chamber gains."""
    cylinder = Cylinder(polytropic_exponent=1.0, control_volume=1e-5, **SEALED)
    rig = Rig((5 * PSI, 5 * PSI), RigParameters(cylinder_a=cylinder, cylinder_b=cylinder))
    truth = sweep(rig, 5e-3, 0.05)
    volumes = cylinder.rest_volume + cylinder.area * truth.displacement
    content = truth.pressures[:, 0] * volumes + truth.sensed_pressures[:, 0] * cylinder.control_volume
    assert np.ptp(truth.sensed_pressures[:, 0]) > 1e3
    assert content == pytest.approx((AMBIENT_PRESSURE + 5 * PSI) * (cylinder.rest_volume + 1e-5), rel=1e-9)


def test_what_flows_in_is_what_the_cylinder_holds_more() -> None:
    """A supply valve held wide open and choked: an isothermal chamber fills at a constant rate."""
    cylinder = Cylinder(polytropic_exponent=1.0, supply_gain=1.0, supply_conductance=1e-11, relief_gain=0.0)
    air = Air()
    rig = Rig((5 * PSI, 5 * PSI), RigParameters(cylinder_a=cylinder))
    truth = hold(rig, 0.02, (20 * PSI, 5 * PSI))
    inflow = 1e-11 * air.supply_pressure * 1.185
    mass = (truth.pressures[:, 0] * cylinder.rest_volume + truth.sensed_pressures[:, 0] * cylinder.control_volume) / (
        air.gas_constant * air.temperature
    )
    assert np.diff(mass) / PERIOD == pytest.approx(inflow, rel=1e-9)


def test_the_integration_converges() -> None:
    """A step at the default length is within a thousandth of the sensor's noise of a much shorter one."""

    def pressures(longest_step: float) -> np.ndarray:
        rig = Rig((5 * PSI, 5 * PSI), longest_step=longest_step)
        schedule = paper_step(5 * PSI)
        return rig.advance(
            schedule.positions, schedule.velocities, (5 * PSI, 5 * PSI), 2e-3 / schedule.knots_per_sample
        ).pressures

    exact = pressures(2.5e-6)
    errors = [np.max(np.abs(pressures(step) - exact)) for step in (2e-4, 1e-4, 5e-5)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.05


def test_pieces_make_the_whole() -> None:
    whole, pieces = Rig((5 * PSI, 10 * PSI)), Rig((5 * PSI, 10 * PSI))
    schedule = paper_step(5 * PSI)
    once = whole.advance(schedule.positions, schedule.velocities, (5 * PSI, 10 * PSI), 2e-4)
    parts = [
        pieces.advance(
            schedule.positions[knot : knot + 7], schedule.velocities[knot : knot + 7], (5 * PSI, 10 * PSI), 2e-4
        )
        for knot in range(0, len(schedule.positions), 7)
    ]
    for name in ('pressures', 'sensed_pressures', 'force', 'acceleration'):
        assert np.array_equal(getattr(once, name), np.concatenate([getattr(part, name) for part in parts])), name


def test_the_load_cell_feels_friction_against_the_motion() -> None:
    slow = RigParameters(seal=Seal(coulomb=2.0))
    there = sweep(Rig((5 * PSI, 5 * PSI), slow), 3e-3, 3.0)
    rig = Rig((5 * PSI, 5 * PSI), slow, position=3e-3)
    back = sweep(rig, 0.0, 3.0)
    thrust = (there.pressures[-1, 0] - there.pressures[-1, 1]) * Cylinder().area
    assert thrust - there.force[-1] == pytest.approx(2.07, abs=0.03)
    thrust = (back.pressures[-1, 0] - back.pressures[-1, 1]) * Cylinder().area
    assert thrust - back.force[-1] == pytest.approx(-2.07, abs=0.03)


@pytest.mark.parametrize(
    ('position', 'setpoints', 'message'),
    [
        (7e-3, (0.0, 0.0), 'travels 6.35 mm'),
        (float('nan'), (0.0, 0.0), 'out of reach'),
        (0.0, (-2e5, 0.0), 'between vacuum and the supply'),
        (0.0, (0.0, 6e5), 'between vacuum and the supply'),
    ],
)
def test_what_the_rig_cannot_do_it_refuses(position: float, setpoints: tuple[float, float], message: str) -> None:
    rig = Rig((5 * PSI, 5 * PSI))
    with pytest.raises(InputError, match=message):
        rig.advance([position], [0.0], setpoints, PERIOD)
    assert rig.time == 0.0
    assert np.all(rig.pressures == AMBIENT_PRESSURE + 5 * PSI)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'cylinder_a': Cylinder(rest_volume=1e-6)}, 'cylinder_a.rest_volume = 1e-06 m.3 is too small'),
        ({'cylinder_b': Cylinder(area=-1.0)}, 'cylinder_b.area = -1'),
        ({'air': Air(temperature=float('inf'))}, 'air.temperature = inf'),
        ({'air': Air(supply_pressure=1e5)}, 'air.supply_pressure'),
        ({'cylinder_a': Cylinder(relief_critical_ratio=1.0)}, 'below 1'),
    ],
)
def test_a_device_that_cannot_be_built_is_refused(changes: dict[str, Cylinder], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Rig((0.0, 0.0), RigParameters(**changes))


def test_whole_numbers_are_taken_as_floats() -> None:
    """An int would make Numba compile the physics anew."""
    parameters = checked(RigParameters(seal=Seal(coulomb=1)))
    assert {type(value) for part in parameters for value in part} == {float}
