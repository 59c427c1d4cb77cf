# SPDX-License-Identifier: Apache-2.0
"""`plan_experiment`: plan the next experiment, and predict the parameters and effects that it determines."""

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


def plan_from_arguments(arguments: Sequence[str] | None = None) -> None:
    """
    Plan an experiment for the device that the arguments name, and write the schedule.

    Raises
    ------
    InputError
        If the parameter file cannot be read, the limits allow no experiment, or the folder cannot be written.

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
    chosen = {name: getattr(options, name) for name in _LIMITS}
    if options.stroke is None:
        chosen['stroke'] = stroke
    limits = Limits(pressures, **chosen)
    FILES.check(options.output, overwrite=options.overwrite)
    wanted = WANTED if options.wanted is None else options.wanted
    proposed = plan(device, limits, sensing, wanted)
    files = write_plan(proposed, options.output, overwrite=options.overwrite)
    console = terminal()
    for name in device.assumed:
        console.print(f'{name} is not in {options.parameters}. The value of Table 1 is used.', style='yellow')
    stroke_source, rate_source = (_source_text(name, options) for name in ('stroke', 'sample_rate'))
    console.print(
        f'Stroke: {1e3 * limits.stroke:.3g} mm, {stroke_source}. '
        f'Sample rate: {sensing.sample_rate:,g} Hz, {rate_source}.{_sampling_advice(wanted, sensing.sample_rate)}'
    )
    print_plan(proposed, console)
    print(f'written: {", ".join(map(str, files))}')


def _source_text(name: str, options: argparse.Namespace) -> str:
    """Return the source of the stroke or the sample rate as text: an option, the report or the default."""
    if getattr(options, name) is not None:
        return f'from --{name.replace("_", "-")}'
    return 'the default' if options.report is None else f'from {options.report}'


def _sampling_advice(wanted: Sequence[str], sample_rate: float) -> str:
    """Return the advice to sample faster than planned [Hz], with the effects that this shows better; empty if none."""
    from cfd_pneumatic.model import EFFECTS

    fast_effects = [EFFECTS[name] for name in wanted if name in EFFECTS and EFFECTS[name].shown_at > sample_rate]
    if not fast_effects:
        return ''
    names = ' and '.join(effect.name for effect in fast_effects)
    rate = max(effect.shown_at for effect in fast_effects)
    return f' A recording at {rate:,g} Hz shows {names} better. To plan for {rate:,g} Hz, add `--sample-rate {rate:g}`.'


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    from cfd_pneumatic.model import NAMES
    from cfd_pneumatic.planning import PAGE_FILE, PLAN_FILE, SCHEDULE_FILE, Limits, Sensing

    limits = Limits((0.0, 0.0))
    sensing = Sensing()
    parser = program.parser_of(
        NAME,
        'Propose displacements and set-points that make parameters and effects identifiable within the '
        'limits of the cell. Predicts the standard error of each parameter, and the visible effects. Writes '
        f'{SCHEDULE_FILE} (time [s], displacement [m], velocity [m/s], gauge set-points [Pa]) for a robot and for '
        f'rig_node, {PAGE_FILE} and {PLAN_FILE}.',
    )
    parser.add_argument(
        'parameters', type=Path, metavar='PARAMETERS', help='parameter file of sim_node, as written by identify_bag'
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
        help='far end of the stroke, which begins at 0 [m]; may be negative '
        f'(default: {limits.stroke:g}, or the stroke in the report)',
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
        help='range of the set-points, gauge [Pa] (default: range in the parameter file; for a single set-point up to '
        '5 psi above)',
    )
    cell.add_argument(
        '--duration',
        type=program.number,
        default=limits.duration,
        metavar='S',
        help='longest duration [s] (default: %(default)s)',
    )
    sensors = parser.add_argument_group('sensors')
    sensors.add_argument(
        '--report',
        type=Path,
        metavar='FILE',
        help='report.json of identify_bag with the noise of the pressures, the sample rate and the stroke',
    )
    for name, metavar, text, alternative in (
        ('pressure_noise', 'PA', "standard deviation of the pressures' noise [Pa]", ", or the report's"),
        (
            'displacement_noise',
            'M',
            "standard deviation of the displacement's noise [m]",
            ", or 0 with the report's pressure noise, which includes the displacement's",
        ),
        ('force_noise', 'N', "standard deviation of the force's noise [N]", ''),
        ('sample_rate', 'HZ', 'sample rate [Hz]', ", or the report's"),
    ):
        help_text = f'{text} (default: {getattr(sensing, name):g}{alternative})'
        sensors.add_argument(f'--{name.replace("_", "-")}', type=program.number, metavar=metavar, help=help_text)
    program.add_overwriting(parser)
    return parser


main = partial(program.run, NAME, plan_from_arguments)

if __name__ == '__main__':
    sys.exit(main())
