# SPDX-License-Identifier: Apache-2.0
"""Draw the devices of the panel: physical devices that follow the paper's model, and their changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig import (
    Air,
    Cylinder,
    CylinderState,
    Effects,
    Oddities,
    Piston,
    Rig,
    RigParameters,
    Seal,
    Stroke,
    Transmission,
    Truth,
    cylinder_rates,
    with_changes,
)
from cfd_pneumatic.units import PSI
from studies.panel.textbook import Gains, draw_gains

SETTLING = 2.0
"""Time for which a rig settles before its recording begins [s]."""


class Clock(NamedTuple):
    """Error of the pressures' time stamps relative to all other stamps."""

    delay: float = 0.0
    """Age of a pressure when its stamp is taken [s]; negative if all other signals are older."""

    gain: float = 0.0
    """Relative rate by which the pressures' clock is fast [-]."""

    def sampled(self, stamps: Array) -> Array:
        """Return the true times [s] of pressures with stamps [s]."""
        return (stamps - self.delay) / (1.0 + self.gain)


class Approach(NamedTuple):
    """State from which a rig settles; the state determines where backlash and friction come to rest."""

    position: float = 0.0
    """Displacement, relative to where it settles [m]."""

    setpoint: float = 0.0
    """Set pressure, relative to the first of the schedule [Pa]."""


class Motion(NamedTuple):
    """Motion and set-points of a rig, at knots one period apart."""

    positions: Array
    """Displacement at the end of each knot's interval [m], (n,)."""

    velocities: Array
    """Velocity there [m/s], (n,)."""

    setpoints: Array
    """Set pressures on the way to each knot, gauge [Pa], (n, 2)."""

    period: float
    """Time between knots [s]."""

    start: float
    """Time before the first interval [s]."""


class Specimen(NamedTuple):
    """A device of the panel with the clock of its instruments."""

    rig: RigParameters
    clock: Clock = Clock()
    approach: Approach = Approach()

    def with_changes(self, changes: dict[str, float]) -> Specimen:
        """Return the specimen with changed fields, named like ``effects_a.play`` or ``clock.delay``."""
        clock_changes = {name.partition('.')[2]: value for name, value in changes.items() if name.startswith('clock.')}
        rig_changes = {name: value for name, value in changes.items() if not name.startswith('clock.')}
        return self._replace(rig=with_changes(self.rig, rig_changes), clock=self.clock._replace(**clock_changes))

    def simulate(self, motion: Motion) -> tuple[Truth, Truth]:
        """Return the true quantities at each knot of a motion from rest, and the quantities at the sensors."""
        home, period = float(motion.positions[0]), motion.period
        levels = motion.setpoints[0]
        knots = round(SETTLING / period)
        quarter = knots // 4
        approach = Stroke(0.0, home + self.approach.position, home, 0.2 * SETTLING, 0.1 * SETTLING, 0.1 * SETTLING)
        rig = Rig(
            (float(levels[0]) + self.approach.setpoint, float(levels[1])),
            self.rig,
            position=approach.start,
            time=motion.start - knots * period,
        )
        positions, velocities = approach(period * np.arange(1.0, knots + 1.0))
        setting = np.tile(levels, (knots, 1))
        setting[:quarter, 0] += self.approach.setpoint
        transmission = Transmission(self.rig, rig.pressures, approach.start)
        transmission.carry(rig.advance(positions, velocities, setting, period), period)
        truth = rig.advance(motion.positions, motion.velocities, motion.setpoints, period)
        return truth, transmission.carry(truth, period)


def cylinder_with(gains: Gains, polytropic_exponent: float, air: Air) -> Cylinder:
    """
    Return a cylinder with given gains and constant coefficients, which follows the paper's model.

    The control chamber is so small that its filling does not change the cylinder's pressure noticeably.
    """
    plain = Cylinder(
        polytropic_exponent=polytropic_exponent,
        supply_gain_growth=0.0,
        control_volume=5e-8,
        pressure_dependence=0.0,
        position_dependence=0.0,
    )
    rest = plain.reference_pressure
    sized = plain._replace(rest_volume=plain.polytropic_exponent * rest * plain.area / gains.k_x)

    sized_gains = gains_of(sized, air)
    return sized._replace(
        supply_gain=sized.supply_gain * gains.k_sv / sized_gains.k_sv,
        relief_gain=sized.relief_gain * gains.k_v / sized_gains.k_v,
        aspirator_diameter=sized.aspirator_diameter / (gains.tau / sized_gains.tau) ** 0.25,
    )


def gains_of(cylinder: Cylinder, air: Air) -> Gains:
    """Return the paper's gains of a cylinder, linearised about its reference pressure."""
    rest = cylinder.reference_pressure

    def rate(outlet: float, sensed: float) -> CylinderState:
        state = CylinderState(outlet, sensed, outlet, air.temperature, 0.0, 0.0, 0.0, 0.0)
        return cylinder_rates(state, 0.0, rest, 0.0, 0.0, cylinder, Effects(), Oddities(), air)

    sensing = rate(rest + 1.0, rest).sensed
    aspirated = cylinder.control_volume / cylinder.rest_volume * sensing
    return Gains(
        k_x=cylinder.polytropic_exponent * rest * cylinder.area / cylinder.rest_volume,
        k_sv=rate(rest, rest - 1.0).outlet + aspirated,
        k_v=aspirated - rate(rest, rest + 1.0).outlet,
        tau=1.0 / sensing,
    )


def draw_specimen(rng: np.random.Generator) -> tuple[Specimen, Gains]:
    """Return a healthy specimen without mass and friction, and the gains of its cylinder A."""
    gains, gains_b = draw_gains(rng), draw_gains(rng)
    air = Air(supply_pressure=Air().ambient_pressure + rng.uniform(45.0, 90.0) * PSI)
    exponent = rng.uniform(1.0, 1.4)
    rig = RigParameters(
        air=air,
        cylinder_a=cylinder_with(gains, exponent, air),
        cylinder_b=cylinder_with(gains_b, exponent, air),
        piston=Piston(mass=0.0),
        seal=Seal(coulomb=0.0, coulomb_per_pressure=0.0, viscous=0.0),
    )
    approach = Approach(position=float(rng.choice([-5e-4, 5e-4])), setpoint=rng.uniform(-1.5e3, 1.5e3))
    return Specimen(rig, approach=approach), gains
