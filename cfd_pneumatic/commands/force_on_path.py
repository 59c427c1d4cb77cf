# SPDX-License-Identifier: Apache-2.0
"""`force_on_path`: predict the contact force along a path, and the set-points that hold it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program

NAME = 'force_on_path'

_PASSED_ON = ('feed', 'bias', 'start', 'scan_error', 'timing_error', 'hold', 'rate', 'slew')
"""Options that are arguments of `path.force_on_path` in the same unit."""


def preview_from_arguments(arguments: Sequence[str] | None = None) -> None:
    """
    Predict the force along the path that the arguments name, and write the preview.

    Raises
    ------
    InputError
        If an input cannot be read, or the device cannot give the force on this path.

    """
    options = make_parser().parse_args(arguments)
    from cfd_pneumatic.path import PREVIEW_FILES, IdentifiedDevice, force_on_path, print_preview, read_path
    from cfd_pneumatic.terminal import terminal

    PREVIEW_FILES.check(options.output, overwrite=options.overwrite)
    console = terminal()
    with console.status('Reading') as status:
        preview = force_on_path(
            IdentifiedDevice.load(options.device),
            read_path(options.path, joint=options.joint, axis=options.axis, topic=options.topic),
            force=options.force,
            tolerance=None if options.tolerance is None else options.tolerance(options.force),
            limits=options.range,
            progress=lambda step: status.update(f'Computing: {step}'),
            **{name: getattr(options, name) for name in _PASSED_ON},
        )
    files = preview.save(options.output, overwrite=options.overwrite)
    print_preview(preview, console)
    print(f'written: {", ".join(map(str, files))}')


def _tolerance(text: str) -> Callable[[float], float]:
    """Return the function that converts the wanted force to a tolerance [N], a force or percent of the wanted force."""
    if text.endswith('%'):
        share = program.number(text[:-1]) / 100.0
        return lambda force: share * abs(force)
    size = program.quantity('force')(text)
    return lambda force: size


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    parser = program.parser_of(
        NAME,
        'Predict the contact force along a path with a 95 % band: force error, set-points, fastest feed, air. With '
        '--hold also compute set-points over time that hold the force. Writes report.html, preview.json, preview.mcap '
        'for Foxglove and PlotJuggler, and schedule.csv for a robot, record_rig and rig_node. Numbers are in SI units, '
        'or have a unit: 0.05mm, 100mm/s, 3bar.',
    )
    length, pressure = program.quantity('length'), program.quantity('pressure')
    parser.add_argument(
        'path',
        type=Path,
        metavar='PATH',
        help='table along_m,error_m (surface minus taught path) or time_s,displacement_m, in any unit (along_mm); or a '
        'bag with piston_state, nav_msgs/Path or trajectory_msgs/JointTrajectory',
    )
    parser.add_argument(
        '--device',
        type=Path,
        required=True,
        metavar='DIR',
        help='output folder of identify_bag, or a parameter file; without the report.json next to it, the band covers '
        'scan and timing only',
    )
    parser.add_argument('--force', type=program.quantity('force'), required=True, metavar='N', help='wanted force [N]')
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='folder for the preview')
    parser.add_argument(
        '--feed', type=program.quantity('length', per_second=True), metavar='M/S', help='speed along the path [m/s]'
    )
    parser.add_argument(
        '--tolerance',
        type=_tolerance,
        metavar='SIZE',
        help='largest accepted force error: 2N, or 10%% of the force (default: none)',
    )
    parser.add_argument(
        '--bias',
        type=pressure,
        metavar='PA',
        help='mean set-point of two cylinders, gauge [Pa] (default: that of the recordings)',
    )
    parser.add_argument(
        '--start',
        type=length,
        metavar='M',
        help='displacement of the piston where the surface has no error [m] (default: the path is centred in the '
        'stroke)',
    )
    parser.add_argument('--joint', default='', help='joint of a bag that holds several')
    parser.add_argument('--axis', default='', help='axis of a nav_msgs/Path along which the piston moves (default: z)')
    parser.add_argument('--topic', default='', help='topic of a bag that holds several paths')
    plan = parser.add_argument_group('errors of the plan, as standard deviations')
    plan.add_argument(
        '--scan-error', type=length, default=0.0, metavar='M', help='error of the surface [m] (default: %(default)s)'
    )
    plan.add_argument(
        '--timing-error',
        type=program.quantity('time'),
        default=0.0,
        metavar='S',
        help='error of the time at which the robot is at a position [s] (default: %(default)s)',
    )
    hold = parser.add_argument_group('set-points that hold the force')
    hold.add_argument('--hold', action='store_true', help='compute set-points over time that hold the force')
    hold.add_argument(
        '--rate', type=program.number, default=50.0, metavar='HZ', help='rate of the set-points [Hz] (default: 50)'
    )
    hold.add_argument(
        '--slew',
        type=program.quantity('pressure', per_second=True),
        metavar='PA/S',
        help='largest rate of a set-point [Pa/s] (default: not limited)',
    )
    hold.add_argument(
        '--range',
        type=pressure,
        nargs=2,
        metavar=('LOW', 'HIGH'),
        help='range of the regulators, gauge [Pa] (default: 0 to the supply pressure of the device)',
    )
    program.add_overwriting(parser)
    return parser


main = partial(program.run, NAME, preview_from_arguments)

if __name__ == '__main__':
    sys.exit(main())
