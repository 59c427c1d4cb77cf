"""
What everything costs, what was promised, and what peers need: docs/speed.md of the figures of two runs.

    make benchmark growth speed-document

`make benchmark` leaves times, and what the benchmarks tell beside them; `make growth` leaves costs against samples.
This program measures nothing. What is missing of a run stands in the document as not measured.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from documents import notes_in, table
from growth import WORKS, Row, rows_in
from provenance import ROOT

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text

SHORT, LONG = (350, 3_600), 3_600_000  # samples of the recordings that are simulated and fitted
ROOM = 16 * 2**20
"""What a reader may hold beside the arrays: a chunk, and what is decoded of it [bytes]."""

MOST_OF_TWO = 1.5
"""Cores that are busy on average from which on two count as used."""

LEAST_LIVE = 600.0
"""How long a live simulator is to be watched before its promise counts as kept [s]."""

HOUR, SHIFT = 3_600_000, 14_400_000
IDENTIFIED = 500 * 2**20  # of memory [bytes]
DECADES = 2.0  # from the largest size down, of which a slope is told


class NotMeasured(Exception):  # noqa: N818
    """A benchmark was left out of a run."""


class Run:
    """What one run of the benchmarks told."""

    def __init__(self, told: Mapping[str, Any]) -> None:
        self.about = {name: told[name] for name in ('machine', 'commit', 'libraries', 'load')}
        self._benchmarks = {one['name']: one for one in told['benchmarks']}

    def fastest(self, name: str) -> float:
        """Return the time of a benchmark's fastest round [s]."""
        return float(self._benchmark(name)['stats']['min'])

    def told(self, name: str) -> Mapping[str, Any]:
        """Return what a benchmark told beside its time."""
        extra: Mapping[str, Any] = self._benchmark(name)['extra_info']
        if not extra:
            raise NotMeasured(name)
        return extra

    def _benchmark(self, name: str) -> Mapping[str, Any]:
        if name not in self._benchmarks:
            raise NotMeasured(name)
        return self._benchmarks[name]


@dataclass(frozen=True)
class Found:
    """What was measured of a promise; whether it is kept, None where this run can't tell; and what a peer needed."""

    measured: str
    kept: bool | None
    peer: str = '-'


@dataclass(frozen=True)
class Promise:
    """Some work, what it may cost, and how that is found in a run."""

    work: str
    reach: str
    find: Callable[[Run], Found]


@dataclass(frozen=True)
class Line:
    """A promise with what became of it."""

    work: str
    reach: str
    found: Found


# how figures are written


def _duration(seconds: float) -> str:
    for unit, scale in (('s', 1.0), ('ms', 1e-3), ('us', 1e-6)):
        if seconds >= scale:
            return f'{seconds / scale:.3g} {unit}' if seconds < 1000.0 else f'{seconds:,.0f} s'
    return f'{seconds * 1e9:.3g} ns'


def _bytes(count: float) -> str:
    return f'{count / 2**20:,.0f} MiB' if count >= 10 * 2**20 else f'{count / 2**20:.1f} MiB'


def _count(number: float) -> str:
    if number < 1e6:
        return f'{number:,.0f}'
    return f'{number / 1e6:.3g} M'


# the promises, in the order of the document


def _each_sample(test: str, most: float) -> Callable[[Run], Found]:
    """Tell the cost of a sample; the shortest recording shows what a call costs beside it, and is not judged."""

    def find(run: Run) -> Found:
        costs = [run.fastest(f'{test}[{samples}]') / samples for samples in (*SHORT, LONG)]
        texts = ' / '.join(f'{1e9 * one:.1f}' for one in costs)
        return Found(f'{texts} ns at 350 / 3,600 / 3.6 M samples', max(costs[1:]) <= most)

    return find


def _error(run: Run) -> Found:
    errors = [run.told(f'test_simulation_to_thirty_digits[{samples}]')['errors_psi'] for samples in SHORT]
    here = max(max(one['exact'], one['irregular']) for one in errors)
    peer = max(one['solve_ivp'] for one in errors)
    return Found(f'{here:.0e} psi', here < 1e-9, f'`solve_ivp`: {peer:.0e} psi')


def _against(ours: str, theirs: str, peer: str, least: float) -> Callable[[Run], Found]:
    """Tell how many times as long as ours a peer takes."""

    def find(run: Run) -> Found:
        pairs = [(run.fastest(f'{ours}[{samples}]'), run.fastest(f'{theirs}[{samples}]')) for samples in SHORT]
        times = [other / own for own, other in pairs]
        here, there = (' / '.join(map(_duration, one)) for one in zip(*pairs))
        text = f'{" / ".join(f"{one:,.0f}" for one in times)} times ({here}) at 350 / 3,600 samples'
        return Found(text, min(times) >= least, f'{peer}: {there}')

    return find


def _same_optimum(run: Run) -> Found:
    apart = {
        peer: max(run.told(f'test_fit_by_{peer}[{samples}]')['apart'] for samples in SHORT)
        for peer in ('casadi', 'lmfit')
    }
    text = f"gains {100 * apart['casadi']:.2f} % from CasADi's, {100 * apart['lmfit']:.2f} % from lmfit's, at most"
    return Found(text, max(apart.values()) < 0.02)


def _within(test: str, most: float) -> Callable[[Run], Found]:
    """Tell the time of a benchmark."""

    def find(run: Run) -> Found:
        seconds = run.fastest(test)
        return Found(_duration(seconds), seconds <= most)

    return find


def _hour_held(run: Run) -> Found:
    told = run.told('test_memory[fit]')
    ratio = told['peak'] / told['arrays']
    return Found(f'{ratio:.2f} times ({_bytes(told["peak"])} of {_bytes(told["arrays"])})', ratio <= 1.5)


MINUTES = ('leakage-60', 'valve_dead_band-12', 'sensor_lag-3', 'heat_transfer-7')
QUARTER = 'test_close_loop[leakage-60-900.0]'


def _minute_closed(run: Run) -> Found:
    seconds = [run.fastest(f'test_close_loop[{one}-60.0]') for one in MINUTES]
    return Found(f'{" / ".join(f"{one:.2f}" for one in seconds)} s with four effects', max(seconds) <= 1.0)


def _cores_used(run: Run) -> Found:
    minute = min(run.told(f'test_close_loop[{one}-60.0]')['cores'] for one in MINUTES)
    quarter = run.told(QUARTER)['cores']
    text = f'{quarter:.2f} busy over 15 min, {minute:.2f} at least over 60 s'
    return Found(text, min(minute, quarter) >= MOST_OF_TWO)


BAGS = ('mcap', 'mcap, zstd', 'sqlite3')


def _reading_against(test: str, peer: str, bags: Sequence[str], least: float | None) -> Callable[[Run], Found]:
    """Tell how many times as long as ours a peer takes, which may be beside the point of the promise."""

    def find(run: Run) -> Found:
        count = run.told(f'test_reading[{bags[0]}]')['messages']
        pairs = [(run.fastest(f'test_reading[{bag}]'), run.fastest(f'{test}[{bag}]')) for bag in bags]
        times = [other / own for own, other in pairs]
        here, there = (' / '.join(f'{1e9 * one / count:,.0f}' for one in some) for some in zip(*pairs))
        kinds = ' / '.join(bag.replace(',', ' with') for bag in bags)
        text = f'{" / ".join(f"{one:.3g}" for one in times)} times ({here} ns a message): {kinds}, {_count(count)}'
        return Found(text, None if least is None else min(times) >= least, f'{peer}: {there} ns')

    return find


def _reading_held(run: Run) -> Found:
    told = [run.told(f'test_memory[read_{storage}]') for storage in ('mcap', 'sqlite3')]
    text = ' / '.join(f'{_bytes(one["peak"])}, arrays {_bytes(one["arrays"])}' for one in told)
    return Found(f'{text}: mcap / sqlite3', all(one['peak'] <= one['arrays'] + ROOM for one in told))


SIM_NODE, PEER = 'test_sim_node', 'test_timer_and_default_executor'
TIMER = 'a timer and the default executor'


def _answered(run: Run) -> Found:
    here, there = run.told(SIM_NODE), run.told(PEER)
    kept = None if here['lost'] == 0 and here['seconds'] < LEAST_LIVE else here['lost'] == 0
    return Found(
        f'{here["lost"]:,} of {here["sent"]:,} unanswered in {here["seconds"]:g} s',
        kept,
        f'{TIMER}: {there["lost"]:,} unanswered',
    )


def _core(run: Run) -> Found:
    here, there = run.told(SIM_NODE)['core'], run.told(PEER)['core']
    return Found(f'{100 * here:.1f} %', here <= 0.2, f'{TIMER}: {100 * there:.1f} %')


def _late(run: Run) -> Found:
    here, there = run.told(SIM_NODE)['latency_p99'], run.told(PEER)['latency_p99']
    return Found(_duration(here), here <= 1e-3, f'{TIMER}: {_duration(there)}')


def _start(run: Run) -> Found:
    told = run.told('test_start')
    ready, answered = told['ready'], told['answered']
    text = f'ready after {np.median(ready):.2f} s, first answers heard after {np.median(answered):.2f} s'
    return Found(f'{text}; of {len(answered)} at most {max(answered):.2f} s', max(answered) <= 1.5)


def _plant(run: Run) -> Found:
    one, two = (run.fastest(f'test_a_plant[{workers}]') for workers in (1, 2))
    efficiency = one / (2.0 * two)
    return Found(f'{efficiency:.2f} ({one:.1f} s and {two:.1f} s for 200 bags)', efficiency >= 0.85)


CASADI = 'CasADi (RK4, exact Jacobian) and scipy'
SOLVE_IVP = '`solve_ivp` (LSODA, 1e-8)'
PROMISES = (
    Promise('simulate, uniform step', 'at most 6 ns a sample', _each_sample('test_simulation', 6e-9)),
    Promise('simulate, any times', 'at most 12 ns a sample', _each_sample('test_simulation_of_irregular_times', 12e-9)),
    Promise(
        'simulate, against a peer',
        'at least 2,000 times faster',
        _against('test_simulation', 'test_simulation_by_solve_ivp', SOLVE_IVP, 2000.0),
    ),
    Promise('simulate: error against thirty digits', 'below 1e-9 psi', _error),
    Promise(
        'simulate with all sensitivities',
        'at most 30 ns a sample',
        _each_sample('test_simulation_with_sensitivities', 30e-9),
    ),
    Promise(
        '10,000 parameter sets over 350 samples',
        'at most 60 ms on 2 cores',
        _within('test_ten_thousand_parameter_sets', 0.06),
    ),
    Promise(
        'fit four parameters',
        'at least 20 times faster',
        _against('test_fit', 'test_fit_by_casadi', CASADI, 20.0),
    ),
    Promise(
        'fit four parameters',
        'at least 20 times faster',
        _against('test_fit', 'test_fit_by_lmfit', 'lmfit and `solve_ivp`', 20.0),
    ),
    Promise('fit four parameters: where it ends', 'the same optimum', _same_optimum),
    Promise('fit four parameters, 1 h at 1 kHz', 'at most 1.5 s', _within(f'test_fit[{LONG}]', 1.5)),
    Promise('fit four parameters, 1 h at 1 kHz: memory', "at most 1.5 times the recording's arrays", _hour_held),
    Promise('close the loop, 60 s at 500 Hz', 'at most 1.0 s', _minute_closed),
    Promise('close the loop, 15 min at 500 Hz', 'at most 10 s', _within(QUARTER, 10.0)),
    Promise('close the loop: cores', f'both used ({MOST_OF_TWO:g} busy at least)', _cores_used),
    Promise(
        'read a bag into arrays',
        'at least 2.5 times as fast',
        _reading_against('test_reading_with_rosbags', 'rosbags', BAGS, 2.5),
    ),
    Promise(
        'read a bag into arrays',
        '-',
        _reading_against('test_reading_with_mcap_ros2_support', 'mcap-ros2-support', BAGS[:2], None),
    ),
    Promise('read a bag into arrays: memory', f'the arrays and a chunk ({_bytes(ROOM)})', _reading_held),
    Promise('`sim_node` at 1 kHz: answers', 'every one for 10 minutes', _answered),
    Promise('`sim_node` at 1 kHz: processor', 'at most 20 % of a core', _core),
    Promise('`sim_node` at 1 kHz: latency p99', 'at most 1 ms on an idle machine', _late),
    Promise('start of `sim_node`, warm caches', 'publishes within 1.5 s', _start),
    Promise('a plant: efficiency of 2 workers', 'at least 0.85', _plant),
)


# how costs grow


@dataclass(frozen=True)
class Growth:
    """Costs against size, ascending, of one work."""

    name: str
    rows: tuple[Row, ...]

    def slope(self, quantity: str) -> float:
        """Return the power of the size with which a quantity grows over the last decades; NaN of a single size."""
        least = self.rows[-1].size / 10.0**DECADES * 0.99
        last = [(row.size, max(getattr(row.cost, quantity), 1e-12)) for row in self.rows if row.size >= least]
        if len(last) < 2:
            return math.nan
        sizes, costs = np.log(last).T
        return float(np.polyfit(sizes, costs, 1)[0])


def growths_of(rows: Iterable[Row]) -> list[Growth]:
    """Return the works in their order, as far as they were measured."""
    some = sorted(rows, key=lambda row: row.size)
    grown = [Growth(name, tuple(row for row in some if row.work == name)) for name in WORKS]
    return [growth for growth in grown if growth.rows]


def long_bags(growths: Sequence[Growth]) -> Found:
    """Tell the memory of identifying a bag of four hours beside one of an hour."""
    held = {row.size: row.cost.peak for one in growths if one.name == 'identify_bag' for row in one.rows}
    if HOUR not in held:
        return Found('not measured', None)
    if SHIFT not in held:
        return Found(f'{_bytes(held[HOUR])} with 1 h; 4 h not measured', False if held[HOUR] > IDENTIFIED else None)
    kept = held[SHIFT] <= IDENTIFIED and held[SHIFT] <= held[HOUR] + ROOM
    return Found(f'{_bytes(held[HOUR])} with 1 h, {_bytes(held[SHIFT])} with 4 h', kept)


LOOKS: dict[str, dict[str, Any]] = {
    name: {'color': colour, 'marker': marker, 'markersize': 4.0, 'linewidth': 1.5}
    for name, colour, marker in zip(
        WORKS, ('#0072b2', '#56b4e9', '#009e73', '#8fbc4f', '#e69f00', '#d55e00', '#7b3294'), 'osDd^Px'
    )
}
PROMISED: dict[str, Any] = {'marker': 'v', 'markersize': 8.0, 'markerfacecolor': 'none', 'linestyle': 'none'}
TIMES = (
    ('simulate', 1_000_000, 6e-3),
    ('simulate_with_sensitivities', 1_000_000, 30e-3),
    ('fit', LONG, 1.5),
    ('close_loop', 30_000, 1.0),
    ('close_loop', 450_000, 10.0),
)
"""What work was promised to take at most, at which size [s]."""

LEAST_SHOWN = 0.1 * 2**20
"""Memory that is drawn where there was less [bytes]."""


def picture_of(growths: Sequence[Growth]) -> str:
    """Return time and memory against samples as SVG, with what was promised."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({'svg.hashsalt': 'speed', 'svg.fonttype': 'none', 'font.size': 9.0}):
        figure = Figure(figsize=(9.5, 5.6), layout='constrained')
        grid = figure.add_gridspec(2, 2, height_ratios=(6.0, 1.0))
        time, memory = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
        for growth in growths:
            look, work = LOOKS[growth.name], WORKS[growth.name]
            sizes = [row.size for row in growth.rows]
            time.plot(sizes, [row.cost.seconds for row in growth.rows], label=f'{work.title} ({work.unit})', **look)
            memory.plot(sizes, [max(row.cost.peak, LEAST_SHOWN) / 2**20 for row in growth.rows], **look)
        time.axline((1e3, 3e-6), (1e6, 3e-3), label='proportional', color='0.6', linestyle='--', linewidth=1.0)
        for name, size, seconds in TIMES:
            time.plot(size, seconds, color=LOOKS[name]['color'], **PROMISED)
        time.plot([], [], color='black', label='promised: at most', **PROMISED)
        memory.plot([HOUR, SHIFT], [IDENTIFIED / 2**20] * 2, color=LOOKS['identify_bag']['color'], **PROMISED)
        time.set(title='Time of the fastest round', ylabel='time [s]')
        memory.set(title='Peak memory above the program and its libraries', ylabel='memory [MiB]')
        for axes in (time, memory):
            axes.set(xscale='log', yscale='log', xlabel='samples, or messages read')
            axes.grid(color='0.88', linewidth=0.6)
            axes.set_axisbelow(True)
            axes.spines[['top', 'right']].set_visible(False)
        legend = figure.add_subplot(grid[1, :])
        legend.axis('off')
        legend.legend(*time.get_legend_handles_labels(), loc='center', ncol=3, frameon=False)
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


# the document


def lines_of(run: Run, growths: Sequence[Growth]) -> list[Line]:
    """Return what became of each promise."""
    lines = []
    for promise in PROMISES:
        try:
            found = promise.find(run)
        except NotMeasured:
            found = Found('not measured', None)
        lines.append(Line(promise.work, promise.reach, found))
    reach = f'{_bytes(IDENTIFIED)}, with 4 h the same as with 1 h, within a chunk ({_bytes(ROOM)})'
    return [*lines, Line('identify a bag at 1 kHz, two cylinders: memory', reach, long_bags(growths))]


def document(run: Run, growths: Sequence[Growth], commit: str, picture: str, notes: str) -> str:
    """Return the document as Markdown; `commit` is that of the growths, `picture` the name of their file."""
    lines = lines_of(run, growths)
    sections = [
        '# Speed\n\nWhat work costs, beside what was promised and what a peer needs that was measured in the same run. '
        'Written by `make speed-document`; what stands under "Notes" at the end is kept.',
        _how_section(run, growths, commit),
        _promises_section(lines),
        _missed_section(lines),
    ]
    if growths:
        sections.append(_growth_section(growths, picture))
    return '\n\n'.join([*sections, notes]).rstrip() + '\n'


def _how_section(run: Run, growths: Sequence[Growth], commit: str) -> str:
    load = run.about['load']
    libraries = ', '.join(f'{name} {version}' for name, version in run.about['libraries'].items())
    lines = [
        '- Commands: `CFD_PNEUMATIC_SECONDS=600 CFD_PNEUMATIC_MESSAGES=10000000 make benchmark`, `make growth`, '
        '`make speed-document`',
        f'- Machine: {run.about["machine"]}',
        f'- Libraries: {libraries}',
        f'- Benchmarks: commit {run.about["commit"]}; load of the machine (mean number of processes that run) '
        f'{load["before"]:.1f} before, {load["after"]:.1f} after',
    ]
    if growths:
        loads = [row.load for growth in growths for row in growth.rows]
        lines.append(f'- Growth: commit {commit}; load {min(loads):.1f} to {max(loads):.1f}')
    return '## How it was measured\n\n' + '\n'.join(lines)


def _promises_section(lines: Sequence[Line]) -> str:
    words = {True: 'yes', False: '**no**', None: ''}
    cells = [(line.work, line.found.measured, line.reach, line.found.peer, words[line.found.kept]) for line in lines]
    return (
        '## Promises\n\nTimes are those of the fastest rounds. What a sample costs is judged from 3,600 samples on; '
        'with 350 the call itself counts. *Kept* is empty where this run is too short to tell.\n\n'
        + table(['work', 'measured', 'promised', 'peer', 'kept'], cells)
    )


def _missed_section(lines: Sequence[Line]) -> str:
    missed = [
        f'- {line.work}: {line.found.measured}; promised was {line.reach}.'
        for line in lines
        if line.found.kept is False
    ]
    return '## Missed\n\n' + ('\n'.join(missed) or 'Nothing.')


def _growth_section(growths: Sequence[Growth], picture: str) -> str:
    lines = []
    for growth in growths:
        work, last = WORKS[growth.name], growth.rows[-1]
        lines.append(
            [
                work.title,
                f'{_count(growth.rows[0].size)} to {_count(last.size)} {work.unit}',
                f'{growth.slope("seconds"):.2f}',
                f'{growth.slope("peak"):.2f}',
                _duration(last.cost.seconds),
                _duration(last.cost.seconds / last.size),
                f'{last.cost.busy / last.cost.seconds:.1f}',
                _bytes(last.cost.peak),
            ]
        )
    header = ['work', 'measured', 'slope of time', 'slope of memory']
    header += ['largest: time', 'each', 'cores busy', 'memory']
    return (
        f'## Growth\n\n![time and memory against samples]({picture})\n\n'
        'Each size in a process of its own; memory is what comes on top of the interpreter with its libraries. Slopes '
        f'are those of the logarithms over the last {DECADES:g} decades: with 1 the cost is proportional to samples, '
        'with 0 it stays the same. Arrays of more than 8 million samples are kept in files, and what of them is in '
        'memory counts.\n\n' + table(header, lines)
    )


# the program


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the document; return the exit code."""
    options = _parsed(arguments)
    try:
        run = Run(_read(options.benchmark, 'make benchmark'))
        growth = _read(options.growth, 'make growth')
    except InputError as error:
        print(f'speed_document: {error}', file=sys.stderr)
        return 2
    growths = growths_of(rows_in(growth))
    picture = options.output.with_suffix('.svg')
    if growths:
        write_text(picture, picture_of(growths))
    write_text(options.output, document(run, growths, growth['commit'], picture.name, notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


def _read(path: Path, command: str) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise InputError(f'{path} holds no figures: run {command} first') from error


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    build = ROOT / 'build'
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--benchmark', type=Path, default=build / 'benchmark.json', help='of make benchmark')
    parser.add_argument('--growth', type=Path, default=build / 'growth.json', help='of make growth')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'speed.md', help='document')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
