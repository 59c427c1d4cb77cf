# SPDX-License-Identifier: Apache-2.0
"""`record_rig`: what a test on the virtual rig leaves, as a bag, without a ROS graph."""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import STORAGES, check_bag, recording_of, write_recording
from cfd_pneumatic.rig import DEVICES, SCHEDULES, device_named, schedule_named

NAME = 'record_rig'

EPOCH = 946_684_800_000_000_000
"""When every test on the rig begins [ns]: the year 2000, so that the same seed gives the same bag."""

OPTIONS = ('setpoint', 'setpoint_b', 'amplitude', 'duration')
"""Options that are handed on to the schedule where they are given."""


def record_bag(arguments: Sequence[str] | None = None) -> None:
    """
    Play the schedule that the arguments name and write its recording.

    Raises
    ------
    InputError
        If the schedule can't be played, or the bag can't be written.

    """
    options = make_parser().parse_args(arguments)
    if options.seed < 0:
        raise InputError(f'--seed {options.seed}: give a number from 0 on')
    check_bag(options.output, overwrite=options.overwrite)
    from cfd_pneumatic.rig import record

    chosen = {name: getattr(options, name) for name in OPTIONS if getattr(options, name) is not None}
    if options.schedule == 'surface_following':
        chosen['seed'] = options.seed
    schedule = schedule_named(options.schedule, **chosen)
    device = device_named(options.device, options.faults)
    recording = recording_of(record(schedule, device, seed=options.seed), schedule.name, EPOCH)
    write_recording(
        options.output, recording, namespace=options.namespace, storage=options.storage, overwrite=options.overwrite
    )
    print(f'{options.output}: {schedule.name}, {schedule.samples:,} samples in {schedule.duration:g} s')


def _defaults(option: str) -> str:
    """Return what an option is by default in each schedule that has it."""
    found = {name: inspect.signature(builder).parameters.get(option) for name, builder in SCHEDULES.items()}
    own = {name: parameter.default for name, parameter in found.items() if parameter is not None}
    return ', '.join(f'{name} {"as A" if value is None else f"{value:g}"}' for name, value in own.items())


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    parser = program.parser_of(
        NAME, 'Play a schedule on the virtual rig and write what its sensors read as a ROS 2 bag.'
    )
    parser.add_argument(
        'schedule', metavar='SCHEDULE', help=f'{", ".join(SCHEDULES)}, or the schedule.csv of plan_experiment'
    )
    parser.add_argument('--output', type=Path, required=True, metavar='BAG', help='folder of the bag to write')
    for option, metavar, text in (
        ('setpoint', 'PA', 'set pressure of cylinder A, gauge [Pa]'),
        ('setpoint_b', 'PA', 'set pressure of cylinder B, gauge [Pa]'),
        ('amplitude', 'M', 'displacement; of a surface its standard deviation [m]'),
        ('duration', 'S', 'length [s]'),
    ):
        help_text = f'{text} (default: {_defaults(option)})'
        parser.add_argument(f'--{option.replace("_", "-")}', type=program.number, metavar=metavar, help=help_text)
    parser.add_argument(
        '--device',
        choices=DEVICES,
        default='real',
        help='a device whose gains change with pressure and position, or that of the paper (default: %(default)s)',
    )
    parser.add_argument(
        '--faults',
        default='',
        metavar='FAULTS',
        help="what is wrong with it: 'effects_a.leak_conductance=1e-10 effects_b.dead_band=300' (default: nothing); "
        'the fields of rig/effects.py and rig/oddities.py, in SI units',
    )
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='picks noise and surface (default: 0)')
    parser.add_argument('--storage', choices=STORAGES, default='mcap', help='format of the bag (default: %(default)s)')
    parser.add_argument('--namespace', default='/cfd/device', help='namespace of the topics (default: %(default)s)')
    program.add_overwriting_of_bags(parser)
    return parser


main = partial(program.run, NAME, record_bag)

if __name__ == '__main__':
    sys.exit(main())
