"""`identify_bag`: fit the model's parameters to recordings."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from cfd_pneumatic.commands.program import run
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.split import FRACTIONS
from cfd_pneumatic.recording import Recording, read_mapping, read_recording
from cfd_pneumatic.reporting import make_folder, print_report, write_report

PROGRESS_KEY = 'progress'
"""With `--progress lines` each line on standard output is JSON: {"progress": share, "what": text}."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='identify_bag',
        description='Fit k_x [Pa/m], k_sv [1/s], k_v [1/s] and tau [s] to recordings of piston displacement and '
        'cylinder pressure, and find what the model lacks. Writes report.json, and parameters.yaml that sim_node runs '
        'with; with --close-loop also report.html for people, and compare.mcap for PlotJuggler and Foxglove.',
        epilog='example: identify_bag cell_7.mcap --close-loop --output cell_7_identified',
    )
    parser.add_argument('bags', metavar='BAG', nargs='+', type=Path, help='ROS 1 or 2 bag, or a table with --mapping')
    parser.add_argument('--output', metavar='DIR', type=Path, required=True, help='folder for the results')
    parser.add_argument(
        '--mapping', metavar='FILE', type=Path, help='YAML file that says what the topics or columns are'
    )
    parser.add_argument('--namespace', help='namespace of the device where the bag holds several, e.g. /cfd/device')
    parser.add_argument(
        '--per-setpoint', action='store_true', help='fit a table of operating points, one for each set-point'
    )
    parser.add_argument(
        '--close-loop',
        action='store_true',
        help='trace what is left of the measured pressure to physical effects that the model lacks, add them, and '
        'report the error before and after',
    )
    parser.add_argument(
        '--split',
        type=_fractions,
        default=FRACTIONS,
        metavar='T/V/T',
        help='percent of train, validation and test (default: 60/20/20)',
    )
    parser.add_argument(
        '--ambient-pressure',
        type=float,
        default=AMBIENT_PRESSURE,
        metavar='PA',
        help='absolute ambient pressure [Pa] (default: %(default)s)',
    )
    parser.add_argument(
        '--progress',
        choices=('bar', 'lines', 'none'),
        default='bar',
        help='how to show progress (default: %(default)s)',
    )
    return parser


def _fractions(text: str) -> tuple[float, float, float]:
    try:
        train, validation, test = (float(part) for part in text.split('/'))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r} is not three numbers such as 60/20/20') from error
    total = train + validation + test
    if min(train, validation, test) <= 0.0:
        raise argparse.ArgumentTypeError(f'{text!r}: each part must be more than nothing')
    return train / total, validation / total, test / total


def main(args: Sequence[str] | None = None) -> int:
    """Run `identify_bag`."""
    return run('identify_bag', _identify, args)


def _identify(args: Sequence[str] | None) -> None:
    arguments = _parser().parse_args(args)
    make_folder(arguments.output)
    options = Options(
        per_setpoint=arguments.per_setpoint,
        fractions=arguments.split,
        ambient_pressure=arguments.ambient_pressure,
        close_loop=arguments.close_loop,
    )
    with _progress(arguments.progress) as report:
        recordings = [_read(path, arguments) for path in arguments.bags]
        report('read', 0.2)
        identification = identify(recordings, options, lambda what, share: report(what, 0.2 + 0.7 * share))
        report('writing the report', 0.9)
        written = write_report(identification, arguments.output)
        report('done', 1.0)
    if arguments.progress != 'lines':
        print_report(identification, Console(width=None if sys.stdout.isatty() else 120))
        print(f'written: {", ".join(map(str, written))}')


@contextmanager
def _progress(style: str) -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows what is being done and which share of the whole is done."""
    if style == 'bar':
        columns = (SpinnerColumn(), TextColumn('{task.description}'), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task('reading', total=1.0)
            yield lambda what, share: bar.update(task, description=what, completed=share)
    elif style == 'lines':
        yield lambda what, share: print(json.dumps({PROGRESS_KEY: share, 'what': what}), flush=True)
    else:
        yield lambda what, share: None


def _read(path: Path, arguments: argparse.Namespace) -> Recording:
    mapping = None if arguments.mapping is None else read_mapping(arguments.mapping)
    if not 1e4 <= arguments.ambient_pressure <= 2e5:
        raise InputError(f'--ambient-pressure {arguments.ambient_pressure:g} Pa is outside 1e4 to 2e5 Pa')
    return read_recording(
        path, mapping=mapping, namespace=arguments.namespace, ambient_pressure=arguments.ambient_pressure
    )


if __name__ == '__main__':
    sys.exit(main())
