# SPDX-License-Identifier: Apache-2.0
"""
What a deburring tool feels along a path: surface error to piston displacement to contact force.

A table tells how far the true surface lies behind the taught one along the path; the piston has to reach as far. Its
course, and the set-points of the wanted force, become a schedule for `record_rig` and `rig_node`. What the model
predicts is drawn beside what the virtual rig measures.
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
REST = 0.5  # before the path and behind it [s]
TRAVEL = RigParameters().piston.travel  # [m]


class Course(NamedTuple):
    """What the piston does over time: displacement, +x towards the workpiece, and its velocity, all (n,)."""

    times: Array
    displacement: Array
    velocity: Array


def follow_path(arguments: Sequence[str] | None = None) -> None:
    """Write the schedule of a path, and the picture of what the tool feels."""
    options = _parser().parse_args(arguments)
    along, error = example() if options.path is None else read_path(options.path)
    course = piston_course(along, error, options.feed)
    device = device_of(options.parameters)
    setpoints = device.model.setpoints(options.force, options.bias)
    if not all(0.0 <= one <= SUPPLY_PRESSURE for one in setpoints):
        raise InputError(
            f'--force {options.force:g} N about --bias {options.bias:g} Pa needs set-points of '
            f'{setpoints[0]:.0f} and {setpoints[1]:.0f} Pa: choose a force nearer to 0, or another bias'
        )
    make_folder(options.output)
    schedule = options.output / 'schedule.csv'
    write_text(schedule, schedule_text(course, setpoints))
    run = record(written_schedule(schedule))
    predicted = predict(device, course, setpoints)
    picture = options.output / 'path.png'
    draw(options.feed, course, run, predicted, options.force).savefig(picture, dpi=120)
    strays = [
        f'{name} by up to {np.max(np.abs(force - options.force)):.1f} N'
        for name, force in (('of the model', predicted), ('of the virtual rig', run.truth.force))
    ]
    print(f'{schedule}: {run.times.size:,} samples')
    print(f'The force strays from {options.force:g} N: that {strays[0]}, that {strays[1]}')
    print(f'{picture}: the path, the displacement, the contact force')


def example() -> tuple[Array, Array]:
    """Return a path along a cast edge: a part that lies 1 mm askew, a wavy surface, a burr [m]."""
    along = np.linspace(0.0, 0.4, 401)
    askew = 1e-3 * along / along[-1]
    waves = 2e-4 * np.sin(2.0 * np.pi * along / 0.06)
    burr = -8e-4 * np.exp(-(((along - 0.25) / 4e-3) ** 2))
    return along, askew + waves + burr


def read_path(path: Path) -> tuple[Array, Array]:
    """Return a table's columns: how far along the path, and how far the surface lies behind the taught one [m]."""
    try:
        head, *rows = path.read_text(encoding='utf-8').splitlines()
        values = np.array([[float(cell) for cell in row.split(',')] for row in rows])
    except (OSError, ValueError) as error:
        raise InputError(f'cannot read {path}: {error}; give a table of numbers below the line {HEAD}') from error
    if head != HEAD or values.ndim != 2 or values.shape[1] != 2 or len(values) < 2:
        raise InputError(f'{path} is no path: its first line is to be {HEAD}, two numbers in each of two rows or more')
    if not np.all(np.isfinite(values)) or not np.all(np.diff(values[:, 0]) > 0.0):
        raise InputError(f'{path}: along_m is to grow from row to row, and all numbers are to be finite')
    return values[:, 0] - values[0, 0], values[:, 1]


def piston_course(along: Array, error: Array, feed: float) -> Course:
    """
    Return the piston's course where it follows the surface at a feed [m/s], with a rest before and behind the path.

    It begins at x = 0, where the robot brought tool and surface together.
    """
    if not feed > 0.0:
        raise InputError(f'--feed {feed:g} m/s: give a positive speed')
    surface = PchipInterpolator(along / feed, error - error[0])  # reaches no farther than the table does
    duration = along[-1] / feed
    times = np.arange(0.0, 2.0 * REST + duration, PERIOD)
    on_path = np.clip(times - REST, 0.0, duration)
    moving = (times > REST) & (times < REST + duration)
    course = Course(times, surface(on_path), np.where(moving, surface.derivative()(on_path), 0.0))
    reach = np.max(np.abs(course.displacement))
    if reach > TRAVEL:
        raise InputError(f'the surface strays by {reach:.4g} m, the piston reaches {TRAVEL:g} m: teach a closer path')
    return course


def schedule_text(course: Course, setpoints: tuple[float, float]) -> str:
    """Return the schedule that `rig_node` and `record_rig` play; set-points are gauge [Pa]."""
    rows = (','.join(map(repr, (*row, *setpoints))) for row in zip(*(column.tolist() for column in course)))
    return '\n'.join([','.join(SCHEDULE_COLUMNS), *rows]) + '\n'


def device_of(parameters: Path | None) -> Device:
    """Return the device of a parameter file, by default that of the paper's Table 1."""
    device = Device.load(parameters or TABLE_1)
    if len(device.model.cylinders) < len(CYLINDERS):
        raise InputError(f'{parameters} describes one cylinder: a contact force has two')
    return device


def predict(device: Device, course: Course, setpoints: tuple[float, float]) -> Array:
    """Return the contact force that `sim_node` would answer to a course, at gauge set-points [Pa], (n,) [N]."""
    moved = sampled(course.times, course.displacement, {})
    answers = device.simulate(moved, setpoints=dict(zip(CYLINDERS, setpoints)), raw=True)
    assert answers.force is not None
    return answers.force.values


def draw(feed: float, course: Course, run: RigRecord, predicted: Array, wanted: float) -> Figure:
    """Return the picture: over the way along the path, the surface and the force."""
    figure = Figure(figsize=(9.0, 5.5), layout='constrained')
    upper, lower = figure.subplots(2, 1, sharex=True)
    way, measured_way = (1e3 * feed * (times - REST) for times in (course.times, run.times))
    upper.plot(way, 1e3 * course.displacement, color='black')
    upper.axhline(0.0, color='grey', linestyle='--', linewidth=1.0)
    upper.set_ylabel('displacement x, mm')
    upper.set_title('the true surface behind the taught path (dashed): where the piston has to reach', loc='left')
    lower.plot(measured_way, run.force, color='tab:blue', linewidth=0.6, label='virtual rig, its load cell')
    lower.plot(way, predicted, color='tab:red', linewidth=1.0, label='model')
    lower.axhline(wanted, color='grey', linestyle='--', linewidth=1.0, label='wanted')
    lower.set_ylabel('contact force, N')
    lower.set_xlabel(f'along the path, mm (feed {1e3 * feed:g} mm/s)')
    lower.legend(loc='best')
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=NAME, description=__doc__)
    parser.add_argument('path', nargs='?', type=Path, metavar='PATH', help=f'table {HEAD}; without one, an example')
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='folder for schedule.csv, path.png')
    parser.add_argument('--parameters', type=Path, metavar='FILE', help="of the model (default: the paper's Table 1)")
    parser.add_argument('--feed', type=float, default=0.05, metavar='M/S', help='along the path (default: %(default)s)')
    parser.add_argument('--force', type=float, default=20.0, metavar='N', help='wanted (default: %(default)s)')
    parser.add_argument(
        '--bias', type=float, default=10 * PSI, metavar='PA', help='mean set-point, gauge (default: %(default).0f)'
    )
    return parser


main = partial(run, NAME, follow_path)

if __name__ == '__main__':
    sys.exit(main())
