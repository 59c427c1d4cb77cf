# SPDX-License-Identifier: Apache-2.0
"""`plan_experiment`: which experiment to do next, and what it will tell."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program

NAME = 'plan_experiment'

_SENSING = ('pressure_noise', 'displacement_noise', 'force_noise', 'sample_rate')
_LIMITS = ('stroke', 'speed', 'acceleration', 'duration')


def propose(arguments: Sequence[str] | None = None) -> None:
    """
    Plan an experiment with the device that the arguments name, and write the schedule.

    Raises
    ------
    InputError
        If the parameter file can't be read, the limits leave nothing, or the folder can't be written.

    """
    options = make_parser().parse_args(arguments)
    from cfd_pneumatic.device import Device, check_run
    from cfd_pneumatic.planning import PLAN_FILES as FILES
    from cfd_pneumatic.planning import (
        WANTED,
        Limits,
        Sensing,
        plan,
        print_plan,
        read_report,
        usual_pressures,
        write_plan,
    )
    from cfd_pneumatic.terminal import terminal

    device = Device.load(options.parameters)
    if options.report is not None:
        check_run(options.parameters, options.report)
    sensing, stroke = (Sensing(), Limits.stroke) if options.report is None else read_report(options.report)
    sensing = replace(sensing, **{name: value for name in _SENSING if (value := getattr(options, name)) is not None})
    pressures = usual_pressures(device) if options.pressures is None else tuple(options.pressures)
    options.stroke = stroke if options.stroke is None else options.stroke
    limits = Limits(pressures, **{name: getattr(options, name) for name in _LIMITS})
    FILES.check(options.output, overwrite=options.overwrite)
    wanted = WANTED if options.wanted is None else options.wanted
    found = plan(device, limits, sensing, wanted)
    files = write_plan(found, options.output, overwrite=options.overwrite)
    console = terminal()
    for name in device.assumed:
        console.print(f'{name} is not in {options.parameters}: planned with Table 1', style='yellow')
    scope = f'planned for strokes of {1e3 * limits.stroke:.3g} mm, sampled at {sensing.sample_rate:g} Hz'
    console.print(f'{scope}{_slowness(wanted, sensing.sample_rate)}')
    print_plan(found, console)
    print(f'written: {", ".join(map(str, files))}')


def _slowness(wanted: Sequence[str], sample_rate: float) -> str:
    """Return which effects a faster sampling than planned for [Hz] would show better, if any."""
    from cfd_pneumatic.model import EFFECTS

    slow = [EFFECTS[name] for name in wanted if name in EFFECTS and EFFECTS[name].shown_at > sample_rate]
    if not slow:
        return ''
    names, rate = ', '.join(one.name for one in slow), max(one.shown_at for one in slow)
    return f'; better seen at --sample-rate {rate:g}: {names}'


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    from cfd_pneumatic.model import NAMES
    from cfd_pneumatic.planning import PICTURE_FILE, PLAN_FILE, SCHEDULE_FILE, Limits, Sensing

    limits = Limits((0.0, 0.0))
    sensing = Sensing()
    parser = program.parser_of(
        NAME,
        'Propose displacements and set-points that make parameters and effects identifiable, within the '
        'limits of the cell, and predict the standard error of each parameter and which effects would show. Writes '
        f'{SCHEDULE_FILE} (time [s], displacement [m], velocity [m/s], gauge set-points [Pa]) for a robot and for '
        f'rig_node, {PLAN_FILE} and {PICTURE_FILE}.',
    )
    parser.add_argument(
        'parameters', type=Path, metavar='PARAMETERS', help='parameter file of sim_node, as identify_bag writes it'
    )
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='folder for the plan')
    parser.add_argument(
        '--wanted',
        nargs='+',
        metavar='NAME',
        help=f'parameters and effects to plan for (default: {", ".join(NAMES)} and all effects)',
    )
    cell = parser.add_argument_group('limits of the cell')
    cell.add_argument(
        '--stroke',
        type=program.number,
        metavar='M',
        help='the piston stays between 0 and this [m]; may be negative '
        f'(default: {limits.stroke:g}, or as far as it went in the report)',
    )
    cell.add_argument(
        '--speed',
        type=program.number,
        default=limits.speed,
        metavar='M/S',
        help='largest speed [m/s] (default: %(default)s)',
    )
    cell.add_argument(
        '--acceleration',
        type=program.number,
        default=limits.acceleration,
        metavar='M/S2',
        help='largest acceleration [m/s^2] (default: %(default)s)',
    )
    cell.add_argument(
        '--pressures',
        type=program.number,
        nargs=2,
        metavar=('LOW', 'HIGH'),
        help='range of the set-points, gauge [Pa] (default: that in the parameter file; from a single one 5 psi up)',
    )
    cell.add_argument(
        '--duration',
        type=program.number,
        default=limits.duration,
        metavar='S',
        help='longest [s] (default: %(default)s)',
    )
    sensors = parser.add_argument_group('sensors')
    sensors.add_argument(
        '--report',
        type=Path,
        metavar='FILE',
        help='report.json of identify_bag to take the noise of the pressures, the sample rate and the stroke from',
    )
    for name, metavar, text, otherwise in (
        ('pressure_noise', 'PA', "standard deviation of the pressures' noise [Pa]", ", or the report's"),
        (
            'displacement_noise',
            'M',
            "standard deviation of the displacement's noise [m]",
            ", or none beside the report's pressure noise, which holds it",
        ),
        ('force_noise', 'N', "standard deviation of the force's noise [N]", ''),
        ('sample_rate', 'HZ', 'samples in a second [Hz]', ", or the report's"),
    ):
        help_text = f'{text} (default: {getattr(sensing, name):g}{otherwise})'
        sensors.add_argument(f'--{name.replace("_", "-")}', type=program.number, metavar=metavar, help=help_text)
    program.add_overwriting(parser)
    return parser


main = partial(program.run, NAME, propose)

if __name__ == '__main__':
    sys.exit(main())
