# SPDX-License-Identifier: Apache-2.0
"""`csv_to_bag`: convert a table of measurements to a bag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import check_recording, describe
from cfd_pneumatic.recording import STORAGES, check_bag, read_mapping, read_recording, write_recording

NAME = 'csv_to_bag'


def convert(arguments: Sequence[str] | None = None) -> None:
    """
    Convert the table that the arguments name to a bag.

    Raises
    ------
    InputError
        If the table or the mapping cannot be read, or the bag cannot be written.

    """
    options = make_parser().parse_args(arguments)
    check_bag(options.output, overwrite=options.overwrite)
    mapping = read_mapping(options.mapping)
    if mapping.table is None:
        raise InputError(f'{options.mapping} maps the topics of a bag. For a table, add the entry `table`')
    recording = read_recording(options.file, mapping=mapping, ambient_pressure=options.ambient_pressure)
    print(f'{recording.name}:')
    notices = check_recording(recording, options.ambient_pressure)
    warnings = [f'{notice.level}: {notice}' for notice in notices]
    for line in (*describe(recording, options.ambient_pressure), *recording.health, *warnings):
        print(f'  {line}')
    write_recording(
        options.output,
        recording,
        namespace=options.namespace,
        storage=options.storage,
        ambient_pressure=options.ambient_pressure,
        overwrite=options.overwrite,
    )
    print(f'bag written to the folder {options.output}')


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    parser = program.parser_of(
        NAME,
        'Convert a table of measurements to a ROS 2 bag in SI units. A mapping file names the columns and their units; '
        'docs/reference/mapping.md describes all entries.',
    )
    parser.add_argument('file', type=Path, metavar='FILE', help='text file with a row for each sample')
    parser.add_argument(
        '--mapping', type=Path, required=True, metavar='FILE', help='YAML file that names the columns and their units'
    )
    parser.add_argument('--output', type=Path, required=True, metavar='BAG', help='folder of the bag to write')
    parser.add_argument('--storage', choices=STORAGES, default='mcap', help='format of the bag (default: %(default)s)')
    parser.add_argument('--namespace', default='/cfd/device', help='namespace of the topics (default: %(default)s)')
    program.add_ambient_pressure(parser, 'absolute ambient pressure, the zero of gauge pressures')
    program.add_overwriting_of_bags(parser)
    return parser


main = partial(program.run, NAME, convert)

if __name__ == '__main__':
    sys.exit(main())
