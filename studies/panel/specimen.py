# SPDX-License-Identifier: Apache-2.0
"""The devices of the panel: the paper's model made of metal, and what is done to it."""

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
"""How long a rig is left alone before its recording begins [s]."""


class Clock(NamedTuple):
    """How the time stamps of the pressures relate to those of all else."""

    delay: float = 0.0
    """How old a pressure is when it is stamped [s]; negative where all else is older."""

    gain: float = 0.0
    """By how much of its own the pressures' clock runs fast."""

    def sampled(self, stamps: Array) -> Array:
        """Return when the pressures with some stamps [s] were there [s]."""
        return (stamps - self.delay) / (1.0 + self.gain)


class Approach(NamedTuple):
    """Where a rig comes from when it settles, which decides where play and friction come to rest."""

    position: float = 0.0
    """Displacement, relative to where it settles [m]."""

    setpoint: float = 0.0
    """Set pressure, relative to the first of the schedule [Pa]."""


class Motion(NamedTuple):
    """What a rig is put through, at knots one period apart."""

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
    """A device with its instruments' clock, as one draw has it."""

    rig: RigParameters
    clock: Clock = Clock()
    approach: Approach = Approach()

    def with_changes(self, changes: dict[str, float]) -> Specimen:
        """Return the specimen with fields changed that are named like ``effects_a.play`` or ``clock.delay``."""
        of_clock = {name.partition('.')[2]: value for name, value in changes.items() if name.startswith('clock.')}
        of_rig = {name: value for name, value in changes.items() if not name.startswith('clock.')}
        return self._replace(rig=with_changes(self.rig, of_rig), clock=self.clock._replace(**of_clock))

    def put_through(self, motion: Motion) -> tuple[Truth, Truth]:
        """Return what happens at each knot of a motion that begins at rest, and what of it arrives at the sensors."""
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
    Return a cylinder with some gains and frozen coefficients, so that it follows the paper's model.

    The control chamber is small enough to be filled from the cylinder unnoticed.
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

    own = gains_of(sized, air)
    return sized._replace(
        supply_gain=sized.supply_gain * gains.k_sv / own.k_sv,
        relief_gain=sized.relief_gain * gains.k_v / own.k_v,
        aspirator_diameter=sized.aspirator_diameter / (gains.tau / own.tau) ** 0.25,
    )


def gains_of(cylinder: Cylinder, air: Air) -> Gains:
    """Return what a cylinder does when little happens about its reference pressure, as the paper's gains."""
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
    gains, other_gains = draw_gains(rng), draw_gains(rng)
    air = Air(supply_pressure=Air().ambient_pressure + rng.uniform(45.0, 90.0) * PSI)
    exponent = rng.uniform(1.0, 1.4)
    rig = RigParameters(
        air=air,
        cylinder_a=cylinder_with(gains, exponent, air),
        cylinder_b=cylinder_with(other_gains, exponent, air),
        piston=Piston(mass=0.0),
        seal=Seal(coulomb=0.0, coulomb_per_pressure=0.0, viscous=0.0),
    )
    approach = Approach(position=float(rng.choice([-5e-4, 5e-4])), setpoint=rng.uniform(-1.5e3, 1.5e3))
    return Specimen(rig, approach=approach), gains
