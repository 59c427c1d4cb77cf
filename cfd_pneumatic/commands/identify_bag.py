# SPDX-License-Identifier: Apache-2.0
"""`identify_bag`: fit the model's parameters to recordings, and find missing effects."""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cfd_pneumatic.commands.program import add_ambient_pressure, add_mapping, add_overwriting, number, parser_of, run
from cfd_pneumatic.errors import InputError

if TYPE_CHECKING:
    from cfd_pneumatic.identification import Options
    from cfd_pneumatic.recording import ChannelMapping, Recording

PROGRESS_KEY, CHECKSUM_KEY = 'progress', 'report_sha256'
"""
Keys of the JSON lines of `--progress lines`: {"progress": share, "what": text}.

The last line also has the SHA-256 of `report.json`, and the verdict on each channel if the loop was closed.
"""

_MOST_JOBS = 256
"""Largest number of processes on this computer; each takes about 200 MB."""

_SPEED_PERIOD = 3600.0
"""Period over which the remaining time is estimated [s]; long, because a bag may take minutes."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    from cfd_pneumatic.identification import AUTO, CORES, FRACTIONS
    from cfd_pneumatic.model import SPECS

    parser = parser_of(
        'identify_bag',
        f'Fit {", ".join(f"{spec.name} [{spec.unit}]" for spec in SPECS)} to recordings of piston displacement and '
        'cylinder pressure, and find what the model lacks. Writes report.json, and parameters.yaml for sim_node. With '
        '--close-loop also writes report.html for people, and compare.mcap for PlotJuggler and Foxglove. Many bags: '
        'identify_bag plant --each --close-loop --output plant_identified.',
    )
    parser.add_argument(
        'bags',
        metavar='BAG',
        nargs='+',
        type=Path,
        help='ROS 1 or 2 bag, or a table with --mapping; with --each also a folder of bags',
    )
    parser.add_argument('--output', metavar='DIR', type=Path, required=True, help='folder for the results')
    add_mapping(parser)
    parser.add_argument(
        '--namespace',
        help='namespace of the device if the bag holds several, e.g. /cfd/device (default: the only namespace)',
    )
    parser.add_argument(
        '--from',
        dest='begin',
        type=number,
        metavar='S',
        help="ignore earlier samples; seconds after each recording's first sample",
    )
    parser.add_argument('--until', dest='end', type=number, metavar='S', help='ignore later samples, likewise')
    parser.add_argument(
        '--per-setpoint', action='store_true', help='fit a table of operating points, one for each set-point'
    )
    parser.add_argument(
        '--close-loop',
        action='store_true',
        help='search for physical effects that explain the residual, add them to the model, and report the error '
        'before and after',
    )
    parser.add_argument(
        '--core',
        choices=CORES,
        default=AUTO,
        help="equations to which effects are added: the paper's linear equations, the physical equations before "
        'linearisation, or those that --close-loop selects (default: %(default)s)',
    )
    parser.add_argument(
        '--thorough',
        action='store_true',
        help='search effects and curves without a limit; may take minutes (default: the search has a limit)',
    )
    parser.add_argument(
        '--tolerance',
        action='append',
        default=[],
        metavar='SIZE',
        help='largest acceptable error, e.g. 300Pa, 2N or 1%% of the span; a smaller error is not `unexplained`; may '
        'be repeated (default: no error is acceptable)',
    )
    parser.add_argument(
        '--draft-effect',
        type=Path,
        metavar='FILE',
        help='write a draft of an effect, NAME.py, from the first estimated curve with a formula; see '
        'docs/how_to/add_an_effect.md',
    )
    parser.add_argument(
        '--verbose',
        action='store_true',
        help='print parameters, errors and candidate effects as tables (default: a summary; the report has all)',
    )
    parser.add_argument(
        '--full',
        action='store_true',
        help='write every sample to compare.mcap (default: minima and maxima above 2 million messages)',
    )
    parser.add_argument(
        '--split',
        type=_fractions,
        default=FRACTIONS,
        metavar='T/V/T',
        help='percent of train, validation and test (default: 60/20/20)',
    )
    add_ambient_pressure(parser, 'absolute ambient pressure')
    parser.add_argument(
        '--area',
        type=number,
        metavar='M2',
        help='area of each piston [m^2], for recordings that do not determine the area (default: the area that gives '
        'the measured force)',
    )
    parser.add_argument(
        '--geometric-factor',
        type=number,
        metavar='RATIO',
        help='contact force / piston force [-], from the linkage (default: included in the area)',
    )
    plant = parser.add_argument_group(
        'a plant',
        'Needs Dask: pip install "cfd_pneumatic[plant]". Writes results.csv, results.parquet, index.html, and a folder '
        'for each bag below the folder of its device. A device has the name of the folder that contains its bags. A '
        'failed bag is a row with the reason. Run the command again to continue after an interruption, or to identify '
        'new and changed bags.',
    )
    plant.add_argument(
        '--each',
        action='store_true',
        help='identify each bag separately, and each bag in the given folders at any depth',
    )
    plant.add_argument(
        '--jobs', type=int, metavar='N', help='bags at the same time (default: the number of processor cores)'
    )
    plant.add_argument(
        '--scheduler',
        type=_address,
        metavar='ADDRESS',
        help='scheduler of a Dask cluster, e.g. tls://host:8786 (default: this computer). Its workers need this '
        'program, and the same files at the same paths',
    )
    plant.add_argument(
        '--certificate',
        type=Path,
        metavar='FOLDER',
        help='folder of the certificate for the scheduler, made with `dask_certificate`',
    )
    parser.add_argument(
        '--progress',
        choices=('bar', 'lines', 'none'),
        default='bar',
        help='how to show progress (default: %(default)s)',
    )
    add_overwriting(parser)
    return parser


def _address(text: str) -> str:
    if not re.fullmatch(r'([a-z]+://)?[^\s/]+:[0-9]{1,5}', text):
        raise argparse.ArgumentTypeError('give the address that the scheduler prints, e.g. tls://host:8786')
    return text


def _fractions(text: str) -> tuple[float, float, float]:
    from cfd_pneumatic.identification import SMALLEST_FRACTION

    try:
        train, validation, test = map(number, text.split('/'))
    except (ValueError, argparse.ArgumentTypeError) as error:
        raise argparse.ArgumentTypeError('give three numbers such as 60/20/20') from error
    total = train + validation + test
    if not SMALLEST_FRACTION * total <= min(train, validation, test) or not 0.0 < total < math.inf:
        raise argparse.ArgumentTypeError(f'each part must be {100 * SMALLEST_FRACTION:g} % of the whole or more')
    return train / total, validation / total, test / total


def _identify(args: Sequence[str] | None) -> None:
    from cfd_pneumatic.identification import Options, tolerance_from
    from cfd_pneumatic.recording import read_mapping

    arguments = make_parser().parse_args(args)
    options = Options(
        per_setpoint=arguments.per_setpoint,
        fractions=arguments.split,
        ambient_pressure=arguments.ambient_pressure,
        close_loop=arguments.close_loop,
        area=arguments.area,
        geometric_factor=arguments.geometric_factor,
        core=arguments.core,
        tolerance=tolerance_from(arguments.tolerance),
        thorough=arguments.thorough,
    )
    _check_draft(arguments)
    mapping = None if arguments.mapping is None else read_mapping(arguments.mapping)
    if arguments.each:
        _identify_each(arguments, options, mapping)
    elif arguments.jobs is not None or arguments.scheduler is not None:
        raise InputError('--jobs and --scheduler are for many bags. Add --each')
    elif arguments.certificate is not None:
        raise InputError('--certificate is for a cluster. Add --scheduler')
    else:
        _identify_together(arguments, options, mapping)


def _check_draft(arguments: argparse.Namespace) -> None:
    """Refuse options that cannot give a draft of an effect, before the work begins."""
    from cfd_pneumatic.files import check_folder, check_replaceable, never
    from cfd_pneumatic.model import EFFECTS

    draft = arguments.draft_effect
    if draft is None:
        return
    if not arguments.close_loop or arguments.each:
        raise InputError('--draft-effect needs the curve of a closed loop. Add --close-loop, and omit --each')
    if draft.suffix != '.py' or not draft.stem.isidentifier() or draft.stem in EFFECTS:
        raise InputError(f'--draft-effect {draft}: the file must be named after a new effect, e.g. scored_bore.py')
    check_replaceable(
        draft, never, overwrite=arguments.overwrite
    )  # never replaced unasked: the user may have edited the draft
    check_folder(draft.parent)


def _identify_together(arguments: argparse.Namespace, options: Options, mapping: ChannelMapping | None) -> None:
    """Identify all bags together."""
    from cfd_pneumatic.files import check_replaceable, make_folder, never, write_text
    from cfd_pneumatic.identification import identify
    from cfd_pneumatic.recording import read_recording
    from cfd_pneumatic.reporting import REPORT_FILES as FILES
    from cfd_pneumatic.reporting import draft_effect, file_names, next_plan, print_report, print_summary, write_report
    from cfd_pneumatic.terminal import terminal

    names = file_names(len(arguments.bags), closed=options.close_loop)
    FILES.check(arguments.output, names, overwrite=arguments.overwrite)
    with _progress(arguments.progress) as report:
        recordings = [
            read_recording(
                path, mapping=mapping, namespace=arguments.namespace, ambient_pressure=options.ambient_pressure
            )
            for path in arguments.bags
        ]
        if arguments.begin is not None or arguments.end is not None:
            recordings = [recording.part(arguments.begin, arguments.end) for recording in recordings]
        report('read', 0.2)
    if arguments.progress != 'lines':
        _print_recordings(recordings, options)
    with (
        _progress(arguments.progress, remaining=True) as report,
        _interruption(stops=options.close_loop) as is_interrupted,
    ):
        identification = identify(
            recordings, options, lambda what, share: report(what, 0.2 + 0.7 * share), is_interrupted
        )
        report('writing the report', 0.9)
        written = write_report(identification, arguments.output, full=arguments.full, overwrite=arguments.overwrite)
        report('done', 1.0)
    if arguments.progress == 'lines':
        conclusions = {name: result.conclusion for name, result in identification.channels.items()}
        verdicts = {name: conclusion.verdict for name, conclusion in conclusions.items() if conclusion is not None}
        print(json.dumps({PROGRESS_KEY: 1.0, 'what': 'done', CHECKSUM_KEY: written.checksum, 'verdicts': verdicts}))
    else:
        if arguments.verbose:
            print_report(identification, terminal(), written.live)
        else:
            print_summary(identification, terminal())
        if not written.complete:
            print('The recording is long: compare.mcap holds minima and maxima only. Use --full to write every sample.')
        command = next_plan(identification, arguments.output)
        if command is not None:
            print(f'To plan the next experiment: {command}')
        _print_files(written.files)
    if arguments.draft_effect is not None:
        text = draft_effect(identification, arguments.draft_effect.stem)
        make_folder(arguments.draft_effect.parent)
        check_replaceable(
            arguments.draft_effect, never, overwrite=arguments.overwrite
        )  # another program may have written the file meanwhile
        write_text(arguments.draft_effect, text)


def _print_files(files: Sequence[Path]) -> None:
    """Print where the results are, the report last."""
    uses = {'.yaml': 'parameters for sim_node and monitor_node', '.mcap': 'curves for PlotJuggler and Foxglove'}
    for path in sorted(files, key=lambda path: path.suffix == '.html'):
        print(f'{uses.get(path.suffix, "report" if path.suffix == ".html" else "numbers for programs")}: {path}')


def _print_recordings(recordings: Sequence[Recording], options: Options) -> None:
    """Print a summary of the recordings and the likely input errors, before the identification takes minutes."""
    from cfd_pneumatic.identification import check_recordings, describe
    from cfd_pneumatic.notices import WARNING

    for recording in recordings:
        print(f'{recording.name}:', *describe(recording, options.ambient_pressure), sep='\n  ')
    warnings = [notice for notice in check_recordings(recordings, options) if notice.level == WARNING]
    for notice in warnings:
        print(f'warning: {notice}')
    if warnings:
        print('The identification continues. Press Ctrl-C twice to end it and correct the input first.')
    sys.stdout.flush()


def _identify_each(arguments: argparse.Namespace, options: Options, mapping: ChannelMapping | None) -> None:
    """Identify each bag separately."""
    try:
        from cfd_pneumatic import plant  # needs Dask and PyArrow, which are optional
    except ModuleNotFoundError as error:
        raise InputError(
            f"--each needs Dask ({error.name}). Install it with pip install 'cfd_pneumatic[plant]'"
        ) from error
    from cfd_pneumatic.files import check_folder, exclusive_access, make_folder

    if arguments.begin is not None or arguments.end is not None:
        raise InputError('--from and --until are for recordings that are identified together. Omit --each')
    if arguments.jobs is not None and arguments.scheduler is not None:
        raise InputError('--jobs and --scheduler: the cluster determines the number of workers. Omit --jobs')
    jobs = len(os.sched_getaffinity(0)) if arguments.jobs is None else arguments.jobs
    if not 1 <= jobs <= _MOST_JOBS:
        raise InputError(f'--jobs {jobs}: the number must be from 1 to {_MOST_JOBS}')
    bags = plant.find_bags(arguments.bags, arguments.output, tables=mapping is not None and mapping.table is not None)
    check_folder(arguments.output)
    make_folder(arguments.output)
    if arguments.scheduler is None:
        cluster = plant.local_cluster(min(jobs, len(bags)))
    else:
        cluster = plant.existing_cluster(arguments.scheduler, arguments.certificate)
        if plant.is_open(arguments.scheduler):
            print(
                f'warning: any computer that reaches {arguments.scheduler} can run programs on its workers. Use tls:// '
                'and --certificate (docs/how_to/many_devices.md).',
                file=sys.stderr,
            )
    settings = plant.Settings(options, mapping, arguments.namespace)
    try:
        with exclusive_access(arguments.output), _progress(arguments.progress, remaining=True) as report:
            results = plant.survey(bags, settings, arguments.output, cluster, report, overwrite=arguments.overwrite)
    except KeyboardInterrupt:
        print('identify_bag: interrupted. Run the same command again to continue', file=sys.stderr)
        raise
    if arguments.progress != 'lines':
        print(results.summary)
        print(f'written: {", ".join(map(str, results.files))}')


@contextmanager
def _interruption(*, stops: bool) -> Iterator[Callable[[], bool]]:
    """
    Yield a function that returns whether Ctrl-C was pressed, if it only stops the search.

    A second Ctrl-C ends the program, as every Ctrl-C does without a search.
    """
    interrupted = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # which alone may handle signals
        yield interrupted.is_set
        return

    def handle(*_: object) -> None:
        if interrupted.is_set() or not stops:
            raise KeyboardInterrupt
        interrupted.set()
        sys.stderr.write('\nThe search ends; the report has the best answer. Press Ctrl-C again to end without one.\n')

    before = signal.signal(signal.SIGINT, handle)
    try:
        yield interrupted.is_set
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _progress(style: str, *, remaining: bool = False) -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows the current task and the completed share of the work."""
    if style == 'bar':
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        columns = [SpinnerColumn(), TextColumn('{task.description}', markup=False), BarColumn(), TimeElapsedColumn()]
        columns += [TimeRemainingColumn()] if remaining else []
        console = Console(stderr=True)
        with Progress(
            *columns,
            console=console,
            transient=True,
            speed_estimate_period=_SPEED_PERIOD,
            disable=not console.is_terminal,
        ) as bar:
            task = bar.add_task('reading', total=1.0)
            yield lambda what, share: bar.update(task, description=what, completed=share)
    elif style == 'lines':
        yield lambda what, share: print(json.dumps({PROGRESS_KEY: share, 'what': what}) + '\n', end='', flush=True)
    else:
        yield lambda what, share: None


main = partial(run, 'identify_bag', _identify)

if __name__ == '__main__':
    sys.exit(main())
