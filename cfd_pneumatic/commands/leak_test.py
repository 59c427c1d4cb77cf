# SPDX-License-Identifier: Apache-2.0
"""`leak_test`: how much leaks behind a shut valve, and by which law."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program
from cfd_pneumatic.errors import InputError

NAME = 'leak_test'


def tell(arguments: Sequence[str] | None = None) -> None:
    """
    Tell the leak of each cylinder in the recording that the arguments name.

    Raises
    ------
    InputError
        If the recording can't be read or tells nothing, or the folder can't be written.

    """
    options = make_parser().parse_args(arguments)
    from cfd_pneumatic.identification import decay_of
    from cfd_pneumatic.recording import read_recording
    from cfd_pneumatic.reporting import LEAK_FILES as FILES
    from cfd_pneumatic.reporting import print_decay, write_decays
    from cfd_pneumatic.terminal import terminal

    if options.begin < 0 or options.begin >= options.end:
        raise InputError(
            f'--begin {options.begin:g} --end {options.end:g}: give seconds from the first sample on, begin before end'
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
        'Tell the leak of a chamber from a recording of its pressure behind a shut valve: the conductance per volume '
        '[1/s] with its interval, which of the leak laws of sim_node it excludes, and whether something settles '
        'beside the leak. Only a pressure is needed; the piston is at rest.',
    )
    parser.add_argument('recording', type=Path, metavar='RECORDING', help='ROS 1 or 2 bag, or a table with --mapping')
    program.add_mapping(parser)
    parser.add_argument('--namespace', help='namespace of the device where the bag holds several, e.g. /cfd/device')
    parser.add_argument('--output', type=Path, metavar='DIR', help='folder for leak.json and leak.svg')
    parser.add_argument(
        '--begin',
        type=program.number,
        default=0.0,
        metavar='S',
        help='time at which the valve is shut [s] (default: 0)',
    )
    parser.add_argument(
        '--end',
        type=program.number,
        default=float('inf'),
        metavar='S',
        help='time at which it opens [s] (default: never)',
    )
    program.add_ambient_pressure(parser, 'what gauge pressures are above, absolute')
    program.add_overwriting(parser)
    return parser


main = partial(program.run, NAME, tell)

if __name__ == '__main__':
    sys.exit(main())
