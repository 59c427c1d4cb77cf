# SPDX-License-Identifier: Apache-2.0
"""
Draw devices, healthy and faulty, and record them.

Each kind of `KINDS` is a function of a seed. Seeds below 1000 are for development, seeds from 5000 on for reports.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import signal

from studies.foreign.cylinder import AMBIENT, DENSITY, GAS, ROOM, Cylinder, Inputs, lugre_friction, simulate
from studies.foreign.excitation import RATE, Array, Plan, motion, setpoints

Random = np.random.Generator

SETTLING = 2 * RATE
"""Samples before the recording, in which the device settles."""

SUPPLY = 7e5
"""Nominal supply pressure [Pa], absolute."""

MIDDLE = 1.6e5 + AMBIENT
"""Mean set-point [Pa], absolute."""


@dataclass
class Draft:
    """
    A device before the simulation; a fault changes it.

    Attributes
    ----------
    plan
        Form of the recording.
    cylinders
        Parameters of each cylinder.
    inputs
        What acts on each cylinder, settling included.
    commands
        Set-points that the logger sees [Pa], absolute, settling included.
    sensor_error
        Function from times [s] and true pressures [Pa] to errors of the pressure sensor [Pa].

    """

    plan: Plan
    cylinders: list[Cylinder]
    inputs: list[Inputs]
    commands: list[Array]
    sensor_error: Callable[[Array, Array], Array] = lambda times, pressure: np.zeros_like(pressure)

    @property
    def times(self) -> Array:
        """Times of the inputs [s]; the recording starts at 0."""
        return (np.arange(self.inputs[0].position.size) - SETTLING) / RATE

    def change(self, **changes: float) -> None:
        """Change parameters of the first cylinder."""
        self.cylinders[0] = self.cylinders[0]._replace(**changes)

    def drive(self, **changes: Array) -> None:
        """Change inputs of the first cylinder."""
        self.inputs[0] = self.inputs[0]._replace(**changes)


@dataclass(frozen=True)
class Recorded:
    """
    Signals that a logger records, in SI units, pressures absolute.

    Attributes
    ----------
    times, displacement
        Times [s] and displacement [m].
    pressures, setpoints
        Pressure and set-point [Pa] of each cylinder.
    force
        Contact force [N], or None.
    truth
        The device and its fault as text.
    noise
        Standard deviation of the noise of the first pressure [Pa].
    contrast
        Effect of the fault on the first pressure, RMS over the recording [Pa]; 0 for healthy devices.
    supply
        Supply pressure of the first cylinder [Pa], not logged.

    """

    times: Array
    displacement: Array
    pressures: list[Array]
    setpoints: list[Array]
    force: Array | None
    truth: str
    noise: float
    contrast: float
    supply: Array


class Kind(NamedTuple):
    """A kind of device: form of its recording, healthy variant, fault."""

    plan: Plan
    variant: Callable[[Random, Draft], str]
    fault: Callable[[Random, Draft], str] | None = None


def record(kind: str, seed: int) -> Recorded:
    """Draw, simulate and record a device."""
    key = (seed, zlib.crc32(kind.encode()))
    drafts = draw(KINDS[kind], key)
    answers = [pressures(draft) for draft, _ in drafts]
    contrast = float(np.sqrt(np.mean((answers[-1][0][0] - answers[0][0][0]) ** 2)))
    draft, truth = drafts[-1]
    return _logged(np.random.default_rng([*key, 1]), draft, answers[-1], truth, contrast)


def draw(kind: Kind, key: Sequence[int]) -> list[tuple[Draft, str]]:
    """Return the healthy device, and the faulty device if the kind has a fault; each with its truth as text."""
    drafts = []
    for fault in (None, kind.fault) if kind.fault else (None,):
        random = np.random.default_rng(key)
        draft = _draft(random, kind.plan)
        truth = kind.variant(random, draft)
        drafts.append((draft, fault(random, draft) if fault else truth))
    return drafts


def pressures(draft: Draft) -> tuple[list[Array], list[Array], Array]:
    """Return read pressures and true pressures of each cylinder [Pa], and the first supply pressure, at 1 kHz."""
    simulated = [simulate(device, inputs) for device, inputs in zip(draft.cylinders, draft.inputs)]
    times = draft.times[SETTLING:]
    true = [chamber[SETTLING:] for chamber, _, _ in simulated]
    read = [pressure + draft.sensor_error(times, pressure) for pressure in true]
    return read, true, simulated[0][1][SETTLING:]


def _draft(random: Random, plan: Plan) -> Draft:
    """Draw a healthy device: PI controller, spool valve, short hose."""
    cylinders = []
    bandwidth = random.uniform(15.0, 50.0)
    area = math.pi / 4.0 * random.choice([16e-3, 20e-3, 25e-3, 32e-3]) ** 2
    for _ in range(plan.cylinders):
        length, dead = random.uniform(15e-3, 40e-3), random.uniform(3e-6, 8e-6)
        volume = area * length + dead
        cell = random.uniform(2.5e-6, 6e-6)
        valve = random.uniform(2e-9, 8e-9)
        gain = bandwidth * (volume + 2.0 * cell) / (GAS * ROOM * valve * DENSITY * SUPPLY)
        integral_time = random.uniform(0.4, 4.0)
        cylinders.append(
            Cylinder(
                area=area,
                length=length,
                dead_volume=dead,
                bore_change=0.0,
                bore_position=0.0,
                bore_width=0.5e-3,
                wall=MIDDLE * volume / (GAS * ROOM) * 718.0 / random.uniform(0.05, 0.6),
                leak=0.0,
                leak_per_speed=0.0,
                valve=valve,
                critical_ratio=random.uniform(0.2, 0.45),
                supply_lap=gain * random.uniform(50.0, 500.0),
                exhaust_lap=gain * random.uniform(50.0, 500.0),
                bleed=0.0,
                spool_frequency=2.0 * math.pi * random.uniform(40.0, 120.0),
                spool_damping=random.uniform(0.5, 1.0),
                gain=gain,
                integral_gain=gain / integral_time,
                integral_zone=random.uniform(50.0, 300.0),
                control_steps=20.0,
                line=random.uniform(4e-9, 12e-9),
                cell_one=cell,
                cell_two=cell,
                tank=random.uniform(0.5e-3, 2e-3),
                feed=random.uniform(5e-9, 10e-9),
            )
        )
    first = cylinders[0]
    depth = (first.area * first.length + first.dead_volume) / first.area
    speed = random.uniform(4e3, 15e3) * bandwidth * depth / MIDDLE
    moved = [np.pad(values, (SETTLING, 0), mode='edge') for values in motion(random, plan, min(speed, 0.15))]
    inputs = []
    for sign in (1.0, -1.0)[: plan.cylinders]:
        target = np.pad(setpoints(random, plan) + AMBIENT, (SETTLING, 0), mode='edge')
        same = np.ones_like(target)
        position, velocity = sign * moved[0], sign * moved[1]
        inputs.append(Inputs(position, velocity, target, SUPPLY * same, ROOM * same, same, 0.0 * same))
    return Draft(plan, cylinders, inputs, [drive.target for drive in inputs])


def _logged(
    random: Random, draft: Draft, answer: tuple[list[Array], list[Array], Array], truth: str, contrast: float
) -> Recorded:
    """Log the signals of a device through sensors with lag, coloured noise and a converter."""
    read, true, supply = answer
    logged = slice(None, None, draft.plan.period)
    span, bits = random.choice([4e5, 6e5, 10e5]), random.choice([12, 14, 16])
    noise = math.hypot(random.uniform(20.0, 120.0), span / 2.0**bits / math.sqrt(12.0))
    pressures = [_sensor(random, pressure, noise, span, int(bits))[logged] for pressure in read]
    position = draft.inputs[0].position[SETTLING:]
    displacement = _sensor(random, position, random.uniform(0.5e-6, 3e-6), 50e-3, 16)[logged]
    force = None
    if len(true) > 1:
        velocity = draft.inputs[0].velocity[SETTLING:]
        coulomb = random.uniform(0.3, 1.5)
        friction = lugre_friction(velocity, coulomb, coulomb * random.uniform(1.1, 1.6), random.uniform(2.0, 15.0))
        first, second = ((pressure - AMBIENT) * device.area for pressure, device in zip(true, draft.cylinders))
        force = _sensor(random, first - second - friction, random.uniform(0.03, 0.2), 500.0, 16)[logged]
        truth += f', LuGre friction with {coulomb:.1f} N Coulomb friction'
    commanded = [command[SETTLING:][logged] for command in draft.commands]
    times = draft.times[SETTLING:][logged]
    return Recorded(times, displacement, pressures, commanded, force, truth, noise, contrast, supply[logged])


def _sensor(random: Random, values: Array, noise: float, span: float, bits: int) -> Array:
    """Return values behind a sensor of second order, with coloured noise and the steps of a converter."""
    frequency, damping = 2.0 * math.pi * random.uniform(60.0, 200.0), random.uniform(0.6, 1.0)
    lag = signal.cont2discrete(([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2]), 1.0 / RATE, 'zoh')
    start = signal.lfilter_zi(lag[0].ravel(), lag[1]) * values[0]
    lagged, _ = signal.lfilter(lag[0].ravel(), lag[1], values, zi=start)
    memory = random.uniform(0.0, 0.8)
    coloured = signal.lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], random.normal(0.0, noise, values.size))
    step = span / 2.0**bits
    return np.round((lagged + coloured) / step) * step


def _start(random: Random, draft: Draft) -> tuple[float, Array]:
    """Return the random time of a change [s], and 1 after the change and 0 before."""
    at = round(draft.plan.seconds * random.uniform(0.3, 0.7), 1)
    return at, (draft.times >= at).astype(float)


def _pi_spool(random: Random, draft: Draft) -> str:
    return 'healthy: spool valve with PI controller'


def _sagging_supply(random: Random, draft: Draft) -> str:
    draft.change(tank=random.uniform(1e-5, 2.5e-5), feed=random.uniform(1e-11, 3e-11))
    return f'healthy: supply tank of {1e6 * draft.cylinders[0].tank:.0f} ml that sags'


def _bleed_regulator(random: Random, draft: Draft) -> str:
    device = draft.cylinders[0]
    bleed = random.uniform(0.5e-11, 3e-11)
    droop = bleed * MIDDLE / (device.valve * SUPPLY * device.gain)
    zone = random.uniform(0.5e3, 2e3)
    draft.change(
        bleed=bleed, integral_gain=0.0, control_steps=1.0, spool_damping=1.0, supply_lap=0.0,
        exhaust_lap=zone * device.gain,
    )  # fmt: skip
    draft.drive(target=draft.inputs[0].target + droop)
    return f'healthy: poppet regulator with {droop:.0f} Pa droop by bleed, {zone:.0f} Pa between supply and relief'


def _distributed_hose(random: Random, draft: Draft) -> str:
    volume = random.uniform(8e-6, 20e-6)
    draft.change(cell_one=volume, cell_two=volume, line=random.uniform(1.5e-9, 3e-9))
    return f'healthy: long hose of two cells, {2e6 * volume:.0f} ml'


def _narrow_hose(random: Random, draft: Draft) -> str:
    draft.change(line=random.uniform(1e-9, 2.5e-9))
    return 'healthy: narrow hose'


def _steps_only(random: Random, draft: Draft) -> str:
    jitter = 1e-3 * draft.inputs[0].position
    draft.drive(position=jitter, velocity=1e-3 * draft.inputs[0].velocity)
    return 'healthy: set-point steps while the piston hardly moves'


def _leak_orifice(random: Random, draft: Draft) -> str:
    draft.change(leak=random.uniform(0.5e-10, 3e-10))
    return f'leak of the chamber, {draft.cylinders[0].leak:.1e} m^3/(s Pa)'


def _leak_speed(random: Random, draft: Draft) -> str:
    draft.change(leak=random.uniform(0.0, 2e-11), leak_per_speed=random.uniform(20.0, 80.0))
    return f'seal leak that grows with speed, {1e-10 * draft.cylinders[0].leak_per_speed:.1e} m^3/(s Pa) per m/s'


def _drift(random: Random, draft: Draft) -> tuple[float, float, Callable[[Array], Array]]:
    """Return size [Pa], time constant as a share of the duration (inf: linear), and the function of time [Pa]."""
    size = random.uniform(2e3, 6e3) * random.choice([-1.0, 1.0])
    constant = random.choice([math.inf, random.uniform(0.15, 0.5)])
    seconds = draft.plan.seconds

    def grown(times: Array) -> Array:
        share = np.clip(times / seconds, 0.0, None)
        return size * share if math.isinf(constant) else size * np.expm1(-share / constant) / np.expm1(-1.0 / constant)

    return size, constant, grown


def _form(constant: float) -> str:
    return 'linear' if math.isinf(constant) else f'exponential with {constant:.2f} of the duration'


def _sensor_drift(random: Random, draft: Draft) -> str:
    size, constant, grown = _drift(random, draft)
    draft.sensor_error = lambda times, pressure: grown(times)
    return f'pressure sensor drifts by {size:.0f} Pa, {_form(constant)}'


def _setpoint_drift(random: Random, draft: Draft) -> str:
    size, constant, grown = _drift(random, draft)
    draft.drive(target=draft.inputs[0].target + grown(draft.times))
    return f'set-point of the regulator drifts by {size:.0f} Pa, {_form(constant)}'


def _warming_supply(random: Random, draft: Draft) -> str:
    rise = random.uniform(30.0, 70.0)
    share = np.clip(draft.times / draft.plan.seconds, 0.0, None)
    draft.drive(feed_temperature=ROOM + rise * share, feed_pressure=SUPPLY * (1.0 + rise / ROOM * share))
    return f'supply warms by {rise:.0f} K, and its pressure rises by {100.0 * rise / ROOM:.0f} %'


def _hose_kink(random: Random, draft: Draft) -> str:
    at, after = _start(random, draft)
    opening = random.uniform(0.2, 0.4)
    draft.drive(hose_opening=1.0 - (1.0 - opening) * after)
    return f'hose passes {100.0 * opening:.0f} % of its flow from {at} s on'


def _sticking_valve(random: Random, draft: Draft) -> str:
    at, after = _start(random, draft)
    width = random.uniform(1e3, 4e3)
    draft.drive(stiction=width * draft.cylinders[0].gain * after)
    return f'spool sticks up to an error of {width:.0f} Pa from {at} s on'


def _supply_down(random: Random, draft: Draft) -> str:
    at, after = _start(random, draft)
    factor = random.uniform(0.5, 0.7)
    draft.change(tank=1e-4)
    draft.drive(feed_pressure=SUPPLY * (1.0 - (1.0 - factor) * after))
    return f'supply falls to {100.0 * factor:.0f} % at {at} s'


def _sensor_bent(random: Random, draft: Draft) -> str:
    bow = random.uniform(0.01, 0.02) * random.choice([-1.0, 1.0])
    low, span = AMBIENT, 2.5e5
    draft.sensor_error = lambda times, pressure: 4.0 * bow * (pressure - low) * (1.0 - (pressure - low) / span)
    return f'pressure sensor is bent by {100.0 * bow:.1f} % of {span / 1e3:.0f} kPa'


def _bore_step(random: Random, draft: Draft) -> str:
    change, at = random.uniform(0.08, 0.2) * random.choice([-1.0, 1.0]), random.uniform(-1e-3, 1e-3)
    draft.change(bore_change=change, bore_position=at)
    return f'piston area changes by {100.0 * change:.0f} % at {1e3 * at:.1f} mm'


def _late_command(random: Random, draft: Draft) -> str:
    late = int(random.integers(20, 61))
    target = draft.inputs[0].target
    draft.drive(target=np.concatenate([np.full(late, target[0]), target[:-late]]))
    return f'set-points act {late} ms late'


KINDS = {
    'pi_spool': Kind(Plan(), _pi_spool),
    'sagging_supply': Kind(Plan(), _sagging_supply),
    'bleed_regulator': Kind(Plan(), _bleed_regulator),
    'distributed_hose': Kind(Plan(), _distributed_hose),
    'steps_only': Kind(Plan(steps=15), _steps_only),
    'slow_sampling': Kind(Plan(period=10), _pi_spool),
    'two_cylinders_force': Kind(Plan(cylinders=2), _pi_spool),
    'leak_orifice': Kind(Plan(), _pi_spool, _leak_orifice),
    'leak_speed': Kind(Plan(), _pi_spool, _leak_speed),
    'sensor_drift': Kind(Plan(), _pi_spool, _sensor_drift),
    'setpoint_drift': Kind(Plan(), _pi_spool, _setpoint_drift),
    'warming_supply': Kind(Plan(), _pi_spool, _warming_supply),
    'hose_kink': Kind(Plan(), _narrow_hose, _hose_kink),
    'sticking_valve': Kind(Plan(), _pi_spool, _sticking_valve),
    'supply_down': Kind(Plan(), _pi_spool, _supply_down),
    'sensor_bent': Kind(Plan(), _pi_spool, _sensor_bent),
    'bore_step': Kind(Plan(), _pi_spool, _bore_step),
    'late_command': Kind(Plan(), _pi_spool, _late_command),
    'short': Kind(Plan(seconds=12.0, steps=3), _pi_spool),
    'no_steps_at_end': Kind(Plan(last_step=0.65), _pi_spool),
    'wider_motion_at_end': Kind(Plan(wider_from=0.8), _pi_spool),
}
"""Kinds of devices by name; seven healthy, eleven faulty, three unusual recordings of healthy devices."""
