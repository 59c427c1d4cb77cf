# SPDX-License-Identifier: Apache-2.0
"""
What everything costs, what was promised, and what peers need: docs/speed.md of what `make benchmark` has measured.

This program measures nothing. What is missing of a run stands in the document as not measured.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cfd_pneumatic.files import write_text
from studies.documents.markdown import notes_in, table
from studies.tools.provenance import ROOT

SHORT, LONG = (350, 3_600), 3_600_000  # samples of the recordings that are simulated and fitted
ROOM = 16 * 2**20
"""What a reader may hold beside the arrays: a chunk, and what is decoded of it [bytes]."""

MOST_OF_PHYSICS = 1.3
"""Processor time of a live simulator with the physical core, over that without [-]."""

MOST_OF_TWO = 1.5
"""Cores that are busy on average from which on two count as used."""

LEAST_LIVE = 600.0
"""How long a live simulator is to be watched before its promise counts as kept [s]."""

READ = 2 * 8
"""What a message takes in arrays: time and value [bytes]."""

SHIFT = 14_400_000
IDENTIFIED, COMPARED = 4 * 10**9, 500 * 10**6
"""What identifying a shift's bag may take, of memory and for its comparison [bytes]."""

GROWN = {
    'read_mcap': 'read a bag, mcap (messages)',
    'read_sqlite3': 'read a bag, sqlite3 (messages)',
    'simulate': 'simulate',
    'simulate_with_sensitivities': 'simulate with all sensitivities',
    'fit': 'fit four parameters',
    'identify_bag': '`identify_bag --close-loop`, two cylinders, report written',
}
"""Work whose cost is measured against samples."""


class NotMeasured(Exception):  # noqa: N818
    """A benchmark was left out of a run."""


class Run:
    """What one run of the benchmarks measured, or several, of which the last says what the others do, too."""

    def __init__(self, *runs: Mapping[str, Any]) -> None:
        self.about = {name: runs[-1][name] for name in ('machine', 'libraries', 'load')}
        self.about['commit'] = ' and '.join(dict.fromkeys(run['commit'] for run in runs))
        self._benchmarks = {one['name']: one for run in runs for one in run['benchmarks']}

    def fastest(self, name: str) -> float:
        """Return the time of a benchmark's fastest round [s]."""
        return float(self._benchmark(name)['stats']['min'])

    def told(self, name: str) -> Mapping[str, Any]:
        """Return what a benchmark told beside its time."""
        extra: Mapping[str, Any] = self._benchmark(name)['extra_info']
        if not extra:
            raise NotMeasured(name)
        return extra

    def grown(self, work: str) -> list[Mapping[str, Any]]:
        """Return what sizes of some work cost, ascending."""
        sizes = [one['extra_info'] for name, one in self._benchmarks.items() if name.startswith(f'test_growth[{work}-')]
        return sorted(sizes, key=lambda one: int(one['size']))

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


# how figures are written


def _duration(seconds: float) -> str:
    for unit, scale in (('s', 1.0), ('ms', 1e-3), ('us', 1e-6)):
        if seconds >= scale:
            return f'{seconds / scale:.3g} {unit}' if seconds < 1000.0 else f'{seconds:,.0f} s'
    return f'{seconds * 1e9:.3g} ns'


def _bytes(count: float) -> str:
    return f'{count / 2**20:,.0f} MiB' if count >= 10 * 2**20 else f'{count / 2**20:.1f} MiB'


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


def _within(test: str, most: float) -> Callable[[Run], Found]:
    """Tell the time of a benchmark."""

    def find(run: Run) -> Found:
        seconds = run.fastest(test)
        return Found(_duration(seconds), seconds <= most)

    return find


def _shift_held(run: Run) -> Found:
    shift = run.told(f'test_growth[identify_bag-{SHIFT}]')
    text = f'{_bytes(shift["peak"])}; compare.mcap {_bytes(shift["compared"])}'
    return Found(text, shift['peak'] <= IDENTIFIED and shift['compared'] <= COMPARED)


COMMANDS = (
    ('test_rig[auto]', '`identify_bag --close-loop`, a minute of the rig at 500 Hz: two cylinders and the force', 4.0),
    ('test_rig[linear]', 'the same with `--core linear`', 2.5),
    ('test_measured[O-ring257_3bar-auto]', 'the same of `O-ring257_3bar`, a measured minute at 100 Hz', None),
    ('test_measured[O-ring257_3bar-linear]', 'this with `--core linear`', 2.5),
    ('test_measured[Kidney_2bar-auto]', 'the same of `Kidney_2bar`, with more effects', 8.0),
    ('test_measured[Kidney_2bar-linear]', 'that with `--core linear`', 6.0),
    ('test_law[out_and_back]', 'the same of a device with a law that no library has, out and back', 8.0),
    ('test_law[surface_following]', 'the same along a surface', 8.0),
    ('test_plan', '`plan_experiment`', 3.0),
    ('test_help[identify_bag]', '`identify_bag --help`', 0.3),
    ('test_help[sim_node]', '`sim_node --help`', 0.3),
    ('test_ready[sim_node]', '`sim_node`, ready, warm caches', 1.0),
    ('test_ready[monitor_node]', '`monitor_node`, ready, warm caches', 1.0),
    ('test_first_start[1]', '`sim_node`, ready, first start', 8.0),
    ('test_first_start[5]', 'five `sim_node` at once, ready, first start', 8.0),
    ('test_compile_kernels', '`compile_kernels`', None),
)
"""Benchmarks of whole commands, what they are, and how many units they may take."""


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


def _reading_against_rosbags(run: Run) -> Found:
    count = run.told(f'test_reading[{BAGS[0]}]')['messages']
    pairs = [(run.fastest(f'test_reading[{bag}]'), run.fastest(f'test_reading_with_rosbags[{bag}]')) for bag in BAGS]
    times = [other / own for own, other in pairs]
    here, there = (' / '.join(f'{1e9 * one / count:,.0f}' for one in some) for some in zip(*pairs))
    kinds = ' / '.join(bag.replace(',', ' with') for bag in BAGS)
    text = f'{" / ".join(f"{one:.3g}" for one in times)} times ({here} ns a message): {kinds}, {count:,}'
    return Found(text, min(times) >= 2.5, f'rosbags: {there} ns')


def _writing_against_rosbags(run: Run) -> Found:
    """Tell how many times as long as ours rosbags takes, whose messages are made already."""
    count = run.told('test_writing[mcap]')['messages']
    here, there = (run.fastest(f'{test}[mcap]') for test in ('test_writing', 'test_writing_with_rosbags'))
    text = f'{there / here:.3g} times ({1e9 * here / count:,.0f} ns a message): mcap, {count:,}'
    return Found(text, there >= 20.0 * here, f'rosbags: {1e9 * there / count:,.0f} ns')


def _reading_held(run: Run) -> Found:
    largest = [run.grown(f'read_{storage}')[-1:] for storage in ('mcap', 'sqlite3')]
    if not all(largest):
        raise NotMeasured('test_growth')
    pairs = [(one['peak'], READ * one['size']) for (one,) in largest]
    text = ' / '.join(f'{_bytes(peak)}, arrays {_bytes(arrays)}' for peak, arrays in pairs)
    return Found(f'{text}: mcap / sqlite3', all(peak <= arrays + ROOM for peak, arrays in pairs))


SIM_NODE, PEER = 'test_sim_node', 'test_timer_and_default_executor'
PHYSICAL = 'test_sim_node_with_the_physical_core'
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


def _of_physics(run: Run) -> Found:
    times = run.told(PHYSICAL)['core'] / run.told(SIM_NODE)['core']
    return Found(f'{times:.2f} times', times <= MOST_OF_PHYSICS, 'without it')


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
    Promise('simulate, slopes', 'at most 30 ns a sample', _each_sample('test_simulation_with_sensitivities', 30e-9)),
    Promise('10,000 parameter sets, 350 samples', 'at most 60 ms', _within('test_ten_thousand_parameter_sets', 0.06)),
    Promise('fit four parameters', 'at least 20 times', _against('test_fit', 'test_fit_by_casadi', CASADI, 20.0)),
    Promise('fit four parameters, 1 h at 1 kHz', 'at most 1.5 s', _within(f'test_fit[{LONG}]', 1.5)),
    Promise('close the loop, 60 s at 500 Hz', 'at most 1.0 s', _minute_closed),
    Promise('close the loop, 15 min at 500 Hz', 'at most 10 s', _within(QUARTER, 10.0)),
    Promise('close the loop: cores', f'both used ({MOST_OF_TWO:g} busy at least)', _cores_used),
    Promise('read a bag into arrays', 'at least 2.5 times as fast', _reading_against_rosbags),
    Promise('read a bag into arrays: memory', f'the arrays and a chunk ({_bytes(ROOM)})', _reading_held),
    Promise('write a bag', 'at least 20 times as fast', _writing_against_rosbags),
    Promise('`sim_node` at 1 kHz: answers', 'every one for 10 minutes', _answered),
    Promise('`sim_node` at 1 kHz: processor', 'at most 20 % of a core', _core),
    Promise('`sim_node` at 1 kHz, physical core: processor', f'at most {MOST_OF_PHYSICS:g} times', _of_physics),
    Promise('`sim_node` at 1 kHz: latency p99', 'at most 1 ms on an idle machine', _late),
    Promise('start of `sim_node`, warm caches', 'publishes within 1.5 s', _start),
    Promise('a plant: efficiency of 2 workers', 'at least 0.85', _plant),
    Promise(
        'identify a bag of 4 h at 1 kHz, two cylinders, with `--close-loop`: memory',
        f'at most {_bytes(IDENTIFIED)}; compare.mcap at most {_bytes(COMPARED)}',
        _shift_held,
    ),
)


# the document


def lines_of(run: Run) -> list[tuple[Promise, Found]]:
    """Return what became of each promise."""
    lines = []
    for promise in PROMISES:
        try:
            found = promise.find(run)
        except NotMeasured:
            found = Found('not measured', None)
        lines.append((promise, found))
    return lines


def document(run: Run, notes: str) -> str:
    """Return the document as Markdown."""
    sections = [
        '# Speed\n\nWhat work costs, beside what was promised and what a peer needs that was measured in the same run. '
        'Written by `make speed-document`; what stands under "Notes" at the end is kept.',
        _how_section(run),
        _commands_section(run),
        _promises_section(lines_of(run)),
        _growth_section(run),
    ]
    return '\n\n'.join([*sections, notes]).rstrip() + '\n'


def _how_section(run: Run) -> str:
    load = run.about['load']
    libraries = ', '.join(f'{name} {version}' for name, version in run.about['libraries'].items())
    return f"""## How it was measured

- Commands: `make benchmark`, `make speed-document`. With `CFD_PNEUMATIC_SECONDS=600`, \
`CFD_PNEUMATIC_MESSAGES=10000000`, `CFD_PNEUMATIC_SAMPLES={SHIFT}` live nodes, bags and growth are measured longer; \
each row says how long it was.
- Machine: {run.about['machine']}
- Libraries: {libraries}
- Commit {run.about['commit']}; load of the machine (mean number of processes that run) {load['before']:.1f} before, \
{load['after']:.1f} after"""


def _commands_section(run: Run) -> str:
    cells, steps = [], []
    for name, work, most in COMMANDS:
        try:
            told = run.told(name)
        except NotMeasured:
            cells.append([work, 'not measured', '', '' if most is None else f'{most:g}', ''])
            continue
        kept = '' if most is None else 'yes' if told['units'] <= most else '**no**'
        units = f'{told["units"]:.2f}'
        cells.append([work, _duration(told['seconds']), units, '-' if most is None else f'at most {most:g}', kept])
        if 'stages' in told:
            steps.append(
                f'- {name.removeprefix("test_")}: ' + '; '.join(f'{when:.2f} s {what}' for what, when in told['stages'])
            )
    return (
        '## Whole commands\n\nWhat a user waits for, each command a process of its own, the median of five. A unit is '
        'what `import numba, scipy.optimize, matplotlib.pyplot` takes in the same run.\n\n'
        + table(['command', 'wall', 'units', 'promised', 'kept'], cells)
        + '\n\nWhen each stage begins, the interpreter and the imports before the first:\n\n'
        + '\n'.join(steps)
    )


def _promises_section(lines: Sequence[tuple[Promise, Found]]) -> str:
    words = {True: 'yes', False: '**no**', None: ''}
    cells = [(one.work, found.measured, one.reach, found.peer, words[found.kept]) for one, found in lines]
    return (
        '## Promises\n\nTimes are those of the fastest rounds. What a sample costs is judged from 3,600 samples on; '
        'with 350 the call itself counts. *Kept* is empty where this run is too short to tell.\n\n'
        + table(['work', 'measured', 'promised', 'peer', 'kept'], cells)
    )


def _growth_section(run: Run) -> str:
    cells = []
    for work, title in GROWN.items():
        for one in run.grown(work):
            seconds, size = one['seconds'], one['size']
            costs = [_duration(seconds), _duration(seconds / size), f'{one["busy"] / seconds:.1f}', _bytes(one['peak'])]
            cells.append([title, f'{size:,}', *costs])
            title = ''
    return (
        '## Growth\n\nEach size in a process of its own; memory is what comes on top of the interpreter with its '
        'libraries. Arrays of more than 8 million samples are kept in files while they are read, and what of them is '
        'in memory counts.\n\n' + table(['work', 'samples', 'time', 'each', 'cores busy', 'memory'], cells)
    )


# the program


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the document; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    figures = ROOT / 'build' / 'benchmark.json'
    parser.add_argument('--benchmark', type=Path, nargs='+', default=[figures], help='figures of make benchmark')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'speed.md', help='document')
    options = parser.parse_args(arguments)
    try:
        run = Run(*(json.loads(path.read_text(encoding='utf-8')) for path in options.benchmark))
    except (OSError, ValueError) as error:
        print(f'speed_document: no figures ({error}): run make benchmark first', file=sys.stderr)
        return 2
    write_text(options.output, document(run, notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
