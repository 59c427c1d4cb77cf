# SPDX-License-Identifier: Apache-2.0
"""
Predict the contact force of a deburring tool along a path from the error of the surface.

A table gives the distance of the true surface behind the taught surface along the path. The piston has to follow this
distance. The program writes the piston's motion, and the set-points of the wanted force, as a schedule for `record_rig`
and `rig_node`. A picture compares the model's force with the measurement of the virtual rig.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.commands import run
from cfd_pneumatic.convention import CYLINDERS, SCHEDULE_COLUMNS, SUPPLY_PRESSURE
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import make_folder, write_text
from cfd_pneumatic.recording import sampled
from cfd_pneumatic.rig import RigParameters, RigRecord, record, written_schedule
from cfd_pneumatic.units import PSI

NAME = 'deburring_path'
TABLE_1 = Path(__file__).resolve().parents[1] / 'config' / 'table_1.yaml'
HEAD = 'along_m,error_m'
PERIOD = 2e-3  # of the schedule's rows [s]
REST = 0.5  # before and after the path [s]
TRAVEL = RigParameters().piston.travel  # [m]


class PistonMotion(NamedTuple):
    """Motion of the piston over time, +x towards the workpiece, all (n,) [s, m, m/s]."""

    times: Array
    displacement: Array
    velocity: Array


def follow_path(arguments: Sequence[str] | None = None) -> None:
    """Write the schedule of a path, and the picture of the contact force."""
    options = _parser().parse_args(arguments)
    along, error = example() if options.path is None else read_path(options.path)
    motion = piston_motion(along, error, options.feed)
    device = device_of(options.parameters)
    setpoints = device.model.setpoints(options.force, options.bias)
    if not all(0.0 <= setpoint <= SUPPLY_PRESSURE for setpoint in setpoints):
        raise InputError(
            f'--force {options.force:g} N about --bias {options.bias:g} Pa needs set-points of '
            f'{setpoints[0]:.0f} and {setpoints[1]:.0f} Pa, but they must be from 0 to {SUPPLY_PRESSURE:.0f} Pa. '
            'Choose a force closer to 0, or a different bias.'
        )
    make_folder(options.output)
    schedule = options.output / 'schedule.csv'
    write_text(schedule, schedule_text(motion, setpoints))
    run = record(written_schedule(schedule))
    predicted = predict(device, motion, setpoints)
    picture = options.output / 'path.png'
    draw(options.feed, motion, run, predicted, options.force).savefig(picture, dpi=120)
    deviations = [f'{np.max(np.abs(force - options.force)):.1f} N' for force in (predicted, run.truth.force)]
    print(f'{schedule}: {run.times.size:,} samples')
    print(f'Largest deviation from {options.force:g} N: model {deviations[0]}, virtual rig {deviations[1]}')
    print(f'{picture}: the path, the displacement, the contact force')


def example() -> tuple[Array, Array]:
    """Return position and surface error along a cast edge: tilted by 1 mm, wavy, with a burr [m]."""
    along = np.linspace(0.0, 0.4, 401)
    tilt = 1e-3 * along / along[-1]
    ripple = 2e-4 * np.sin(2.0 * np.pi * along / 0.06)
    burr = -8e-4 * np.exp(-(((along - 0.25) / 4e-3) ** 2))
    return along, tilt + ripple + burr


def read_path(path: Path) -> tuple[Array, Array]:
    """Return a table's columns: position along the path, and distance of the surface behind the taught path [m]."""
    try:
        head, *rows = path.read_text(encoding='utf-8').splitlines()
        values = np.array([[float(cell) for cell in row.split(',')] for row in rows])
    except (OSError, ValueError) as error:
        raise InputError(f'{path} cannot be read: {error}. Give a table of numbers below the line {HEAD}.') from error
    if head != HEAD or values.ndim != 2 or values.shape[1] != 2 or len(values) < 2:
        raise InputError(
            f'{path} is not a path. The first line must be {HEAD}, followed by two rows or more of two numbers.'
        )
    if not np.all(np.isfinite(values)) or not np.all(np.diff(values[:, 0]) > 0.0):
        raise InputError(
            f'{path}: along_m must increase from row to row, and all numbers must be finite. Correct the table.'
        )
    return values[:, 0] - values[0, 0], values[:, 1]


def piston_motion(along: Array, error: Array, feed: float) -> PistonMotion:
    """
    Return the piston's motion along the surface at a feed [m/s], with a rest before and after the path.

    The motion begins at x = 0, the position at which the robot made contact.
    """
    if not feed > 0.0:
        raise InputError(f'--feed must be a positive speed, is {feed:g} m/s')
    surface = PchipInterpolator(along / feed, error - error[0])  # does not overshoot the values of the table
    duration = along[-1] / feed
    times = np.arange(0.0, 2.0 * REST + duration, PERIOD)
    on_path = np.clip(times - REST, 0.0, duration)
    moving = (times > REST) & (times < REST + duration)
    motion = PistonMotion(times, surface(on_path), np.where(moving, surface.derivative()(on_path), 0.0))
    reach = np.max(np.abs(motion.displacement))
    if reach > TRAVEL:
        raise InputError(
            f'the surface deviates by {reach:.4g} m, but the piston reaches only {TRAVEL:g} m. '
            'Teach a path that is closer to the surface.'
        )
    return motion


def schedule_text(motion: PistonMotion, setpoints: tuple[float, float]) -> str:
    """Return the schedule for `rig_node` and `record_rig` as text; set-points are gauge [Pa]."""
    rows = (','.join(map(repr, (*row, *setpoints))) for row in zip(*(column.tolist() for column in motion)))
    return '\n'.join([','.join(SCHEDULE_COLUMNS), *rows]) + '\n'


def device_of(parameters: Path | None) -> Device:
    """Return the device of a parameter file; None: the device of the paper's Table 1."""
    device = Device.load(parameters or TABLE_1)
    if len(device.model.cylinders) < len(CYLINDERS):
        raise InputError(
            f'{parameters} describes one cylinder, but the contact force needs two. Give a file with both cylinders.'
        )
    return device


def predict(device: Device, motion: PistonMotion, setpoints: tuple[float, float]) -> Array:
    """Return the model's contact force for a motion at gauge set-points [Pa], (n,) [N]."""
    moved = sampled(motion.times, motion.displacement, {})
    answers = device.simulate(moved, setpoints=dict(zip(CYLINDERS, setpoints)), raw=True)
    assert answers.force is not None
    return answers.force.values


def draw(feed: float, motion: PistonMotion, run: RigRecord, predicted: Array, wanted: float) -> Figure:
    """Plot the surface and the force over the position along the path."""
    figure = Figure(figsize=(9.0, 5.5), layout='constrained')
    upper, lower = figure.subplots(2, 1, sharex=True)
    along, measured_along = (1e3 * feed * (times - REST) for times in (motion.times, run.times))
    upper.plot(along, 1e3 * motion.displacement, color='black')
    upper.axhline(0.0, color='grey', linestyle='--', linewidth=1.0)
    upper.set_ylabel('displacement x, mm')
    upper.set_title('true surface relative to the taught path (dashed), followed by the piston', loc='left')
    lower.plot(measured_along, run.force, color='tab:blue', linewidth=0.6, label='virtual rig, its load cell')
    lower.plot(along, predicted, color='tab:red', linewidth=1.0, label='model')
    lower.axhline(wanted, color='grey', linestyle='--', linewidth=1.0, label='wanted')
    lower.set_ylabel('contact force, N')
    lower.set_xlabel(f'along the path, mm (feed {1e3 * feed:g} mm/s)')
    lower.legend(loc='best')
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=NAME, description=__doc__)
    parser.add_argument('path', nargs='?', type=Path, metavar='PATH', help=f'table {HEAD} (default: an example)')
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='folder for schedule.csv, path.png')
    parser.add_argument(
        '--parameters', type=Path, metavar='FILE', help="parameters of the model (default: the paper's Table 1)"
    )
    parser.add_argument(
        '--feed', type=float, default=0.05, metavar='M/S', help='speed along the path (default: %(default)s)'
    )
    parser.add_argument(
        '--force', type=float, default=20.0, metavar='N', help='wanted contact force (default: %(default)s)'
    )
    parser.add_argument(
        '--bias', type=float, default=10 * PSI, metavar='PA', help='mean set-point, gauge (default: %(default).0f)'
    )
    return parser


main = partial(run, NAME, follow_path)

if __name__ == '__main__':
    sys.exit(main())
