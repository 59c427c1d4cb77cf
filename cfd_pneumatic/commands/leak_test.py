# SPDX-License-Identifier: Apache-2.0
"""`leak_test`: estimate the leak of a chamber behind a shut valve, and select the leak model."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program
from cfd_pneumatic.errors import InputError

NAME = 'leak_test'


def estimate_leaks(arguments: Sequence[str] | None = None) -> None:
    """
    Estimate and print the leak of each cylinder in the recording that the arguments name.

    Raises
    ------
    InputError
        If the recording cannot be read or determines no leak, or the folder cannot be written.

    """
    options = make_parser().parse_args(arguments)
    from cfd_pneumatic.identification import decay_of
    from cfd_pneumatic.recording import read_recording
    from cfd_pneumatic.reporting import LEAK_FILES as FILES
    from cfd_pneumatic.reporting import print_decay, write_decays
    from cfd_pneumatic.terminal import terminal

    if options.begin < 0 or options.begin >= options.end:
        raise InputError(
            f'--begin {options.begin:g} --end {options.end:g}: both are seconds after the first sample. Begin must be '
            'before end'
        )
    if options.output is not None:
        FILES.check(options.output, overwrite=options.overwrite)
    ambient = options.ambient_pressure
    recording = read_recording(
        options.recording, mapping=options.mapping, namespace=options.namespace, ambient_pressure=ambient
    )
    console = terminal()
    for line in recording.health:
        console.print(f'{recording.name}: {line}', style='yellow')
    decays = {}
    for name, signals in recording.cylinders.items():
        begin = float(signals.pressure.times[0])
        part = signals.pressure.between(begin + options.begin, begin + options.end)
        try:
            decays[name] = decay_of(part, ambient)
        except InputError as error:
            raise InputError(f'{options.recording}: {name}/pressure: {error}') from error
    for name, decay in decays.items():
        print_decay(name, decay, console)
    if options.output is not None:
        files = write_decays(decays, options.output, overwrite=options.overwrite)
        print(f'written: {", ".join(map(str, files))}')


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    parser = program.parser_of(
        NAME,
        'Estimate the leak of a chamber from a recording of its pressure behind a shut valve. Prints the conductance '
        'per volume [1/s] with its interval, the leak models of sim_node that the recording excludes, and settling of '
        'the pressure in addition to the leak. Only the pressure is needed. The piston must be at rest.',
    )
    parser.add_argument('recording', type=Path, metavar='RECORDING', help='ROS 1 or 2 bag, or a table with --mapping')
    program.add_mapping(parser)
    parser.add_argument('--namespace', help='namespace of the device if the bag holds several, e.g. /cfd/device')
    parser.add_argument('--output', type=Path, metavar='DIR', help='folder for leak.json and leak.svg')
    parser.add_argument(
        '--begin',
        type=program.number,
        default=0.0,
        metavar='S',
        help='time at which the valve is shut [s], after the first sample (default: 0)',
    )
    parser.add_argument(
        '--end',
        type=program.number,
        default=float('inf'),
        metavar='S',
        help='time at which the valve opens [s], after the first sample (default: never)',
    )
    program.add_ambient_pressure(parser, 'absolute ambient pressure, the zero of gauge pressures')
    program.add_overwriting(parser)
    return parser


main = partial(program.run, NAME, estimate_leaks)

if __name__ == '__main__':
    sys.exit(main())
