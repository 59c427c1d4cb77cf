# SPDX-License-Identifier: Apache-2.0
"""`record_rig`: record an experiment on the virtual rig as a bag, without a ROS graph."""

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
"""Begin of every recording [ns]: the year 2000, so that equal seeds give equal bags."""

SCHEDULE_OPTIONS = ('setpoint', 'setpoint_b', 'amplitude', 'duration')
"""Options that are passed to the schedule if they are given."""


def record_bag(arguments: Sequence[str] | None = None) -> None:
    """
    Play the schedule that the arguments name on the rig, and write the recording.

    Raises
    ------
    InputError
        If the schedule cannot be played, or the bag cannot be written.

    """
    options = make_parser().parse_args(arguments)
    if options.seed < 0:
        raise InputError(f'--seed {options.seed}: the seed must not be negative')
    check_bag(options.output, overwrite=options.overwrite)
    from cfd_pneumatic.rig import record

    settings = {name: getattr(options, name) for name in SCHEDULE_OPTIONS if getattr(options, name) is not None}
    if options.schedule == 'surface_following':
        settings['seed'] = options.seed
    schedule = schedule_named(options.schedule, **settings)
    device = device_named(options.device, options.faults)
    recording = recording_of(record(schedule, device, seed=options.seed), schedule.name, EPOCH)
    write_recording(
        options.output, recording, namespace=options.namespace, storage=options.storage, overwrite=options.overwrite
    )
    faults = f'; faults: {options.faults}' if options.faults.strip() else ''
    print(
        f'bag written to the folder {options.output}: {schedule.name}, {schedule.samples:,} samples in '
        f'{schedule.duration:g} s{faults}'
    )


def _defaults(option: str) -> str:
    """Return the default values of an option in the schedules that have the option, as text."""
    parameters = {name: inspect.signature(builder).parameters.get(option) for name, builder in SCHEDULES.items()}
    defaults = {name: parameter.default for name, parameter in parameters.items() if parameter is not None}
    return ', '.join(f'{name} {"as A" if value is None else f"{value:g}"}' for name, value in defaults.items())


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    parser = program.parser_of(NAME, 'Play a schedule on the virtual rig and write the sensor signals as a ROS 2 bag.')
    parser.add_argument(
        'schedule',
        metavar='SCHEDULE',
        help=f'{", ".join(SCHEDULES)}, or the schedule.csv of plan_experiment or force_on_path',
    )
    parser.add_argument('--output', type=Path, required=True, metavar='BAG', help='folder of the bag to write')
    for option, metavar, text in (
        ('setpoint', 'PA', 'set pressure of cylinder A, gauge [Pa]'),
        ('setpoint_b', 'PA', 'set pressure of cylinder B, gauge [Pa]'),
        ('amplitude', 'M', 'amplitude of the displacement; for a surface the standard deviation [m]'),
        ('duration', 'S', 'duration [s]'),
    ):
        help_text = f'{text} (default: {_defaults(option)})'
        parser.add_argument(f'--{option.replace("_", "-")}', type=program.number, metavar=metavar, help=help_text)
    parser.add_argument(
        '--device',
        choices=DEVICES,
        default='real',
        help='`real`: gains depend on pressure and position; `paper`: device of the paper (default: %(default)s)',
    )
    parser.add_argument(
        '--faults',
        default='',
        metavar='FAULTS',
        help="faults of the device: 'effects_a.leak_conductance=1e-10 effects_b.dead_band=300' (default: none); "
        'names are the fields of rig/effects.py and rig/oddities.py, in SI units',
    )
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N', help='seed of the noise and the surface (default: 0)'
    )
    parser.add_argument('--storage', choices=STORAGES, default='mcap', help='format of the bag (default: %(default)s)')
    parser.add_argument('--namespace', default='/cfd/device', help='namespace of the topics (default: %(default)s)')
    program.add_overwriting_of_bags(parser)
    return parser


main = partial(program.run, NAME, record_bag)

if __name__ == '__main__':
    sys.exit(main())
