# SPDX-License-Identifier: Apache-2.0
"""
Write docs/measurements/speed.md from the measurements of `make benchmark`: costs, promises, and costs of peers.

This program measures nothing. The document marks benchmarks that a run lacks as not measured.
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
"""Memory that a reader may use in addition to the arrays, for a chunk and its decoded messages [bytes]."""

MOST_PHYSICAL_COST = 1.3
"""Largest ratio of processor times of `sim_node`: with the physical core to without [-]."""

LEAST_BUSY_CORES = 1.5
"""Smallest mean number of busy cores at which two cores count as used."""

LEAST_LIVE_DURATION = 600.0
"""Shortest measurement of `sim_node` after which its promise counts as kept [s]."""

BYTES_PER_MESSAGE = 2 * 8
"""Size of a message in arrays: time and value [bytes]."""

SHIFT = 14_400_000
IDENTIFIED, COMPARED = 4 * 10**9, 500 * 10**6
"""Largest memory of an identification of a shift's bag, and largest size of its compare.mcap [bytes]."""

GROWN = {
    'read_mcap': 'read a bag, mcap (messages)',
    'read_sqlite3': 'read a bag, sqlite3 (messages)',
    'simulate': 'simulate',
    'simulate_with_sensitivities': 'simulate with all sensitivities',
    'fit': 'fit four parameters',
    'identify_bag': '`identify_bag --close-loop`, two cylinders, report written',
}
"""Titles of work with costs measured for several numbers of samples."""
DOCUMENT = ROOT / 'docs' / 'measurements' / 'speed.md'


class NotMeasured(Exception):  # noqa: N818
    """A run does not contain a benchmark."""


class Run:
    """Measurements of one or several runs of the benchmarks; later runs replace earlier ones."""

    def __init__(self, *runs: Mapping[str, Any]) -> None:
        self.about = {name: runs[-1][name] for name in ('machine', 'libraries', 'load')}
        self.about['commit'] = ' and '.join(dict.fromkeys(run['commit'] for run in runs))
        self._benchmarks = {benchmark['name']: benchmark for run in runs for benchmark in run['benchmarks']}

    def fastest(self, name: str) -> float:
        """Return the time of a benchmark's fastest round [s]."""
        return float(self._benchmark(name)['stats']['min'])

    def extra_values(self, name: str) -> Mapping[str, Any]:
        """Return the values that a benchmark measured in addition to time."""
        extra: Mapping[str, Any] = self._benchmark(name)['extra_info']
        if not extra:
            raise NotMeasured(name)
        return extra

    def growth(self, work: str) -> list[Mapping[str, Any]]:
        """Return the costs of a kind of work by ascending number of samples."""
        prefix = f'test_growth[{work}-'
        costs = [benchmark['extra_info'] for name, benchmark in self._benchmarks.items() if name.startswith(prefix)]
        return sorted(costs, key=lambda cost: int(cost['size']))

    def _benchmark(self, name: str) -> Mapping[str, Any]:
        if name not in self._benchmarks:
            raise NotMeasured(name)
        return self._benchmarks[name]


@dataclass(frozen=True)
class Outcome:
    """Measured value of a promise, whether it is kept (None: the run is too short), and the peer's value."""

    measured: str
    kept: bool | None
    peer: str = '-'


@dataclass(frozen=True)
class Promise:
    """A kind of work, its promised cost, and the function that reads the cost from a run."""

    work: str
    limit: str
    read_outcome: Callable[[Run], Outcome]


# formats of figures


def _duration(seconds: float) -> str:
    for unit, scale in (('s', 1.0), ('ms', 1e-3), ('us', 1e-6)):
        if seconds >= scale:
            return f'{seconds / scale:.3g} {unit}' if seconds < 1000.0 else f'{seconds:,.0f} s'
    return f'{seconds * 1e9:.3g} ns'


def _bytes(count: float) -> str:
    return f'{count / 2**20:,.0f} MiB' if count >= 10 * 2**20 else f'{count / 2**20:.1f} MiB'


# the promises, in the order of the document


def _each_sample(test: str, most: float) -> Callable[[Run], Outcome]:
    """Return a function that reads the cost of a sample; the shortest recording is shown and not judged."""

    def find(run: Run) -> Outcome:
        costs = [run.fastest(f'{test}[{samples}]') / samples for samples in (*SHORT, LONG)]
        texts = ' / '.join(f'{1e9 * cost:.1f}' for cost in costs)
        return Outcome(f'{texts} ns at 350 / 3,600 / 3.6 M samples', max(costs[1:]) <= most)

    return find


def _error(run: Run) -> Outcome:
    errors = [run.extra_values(f'test_simulation_to_thirty_digits[{samples}]')['errors_psi'] for samples in SHORT]
    here = max(max(error['exact'], error['irregular']) for error in errors)
    peer = max(error['solve_ivp'] for error in errors)
    return Outcome(f'{here:.0e} psi', here < 1e-9, f'`solve_ivp`: {peer:.0e} psi')


def _against(ours: str, theirs: str, peer: str, least: float) -> Callable[[Run], Outcome]:
    """Return a function that reads the ratio of a peer's time to the package's time."""

    def find(run: Run) -> Outcome:
        pairs = [(run.fastest(f'{ours}[{samples}]'), run.fastest(f'{theirs}[{samples}]')) for samples in SHORT]
        ratios = [their_time / our_time for our_time, their_time in pairs]
        here, there = (' / '.join(map(_duration, durations)) for durations in zip(*pairs))
        text = f'{" / ".join(f"{ratio:,.0f}" for ratio in ratios)} times ({here}) at 350 / 3,600 samples'
        return Outcome(text, min(ratios) >= least, f'{peer}: {there}')

    return find


def _within(test: str, most: float) -> Callable[[Run], Outcome]:
    """Return a function that reads the time of a benchmark."""

    def find(run: Run) -> Outcome:
        seconds = run.fastest(test)
        return Outcome(_duration(seconds), seconds <= most)

    return find


def _shift_held(run: Run) -> Outcome:
    shift = run.extra_values(f'test_growth[identify_bag-{SHIFT}]')
    text = f'{_bytes(shift["peak"])}; compare.mcap {_bytes(shift["compared"])}'
    return Outcome(text, shift['peak'] <= IDENTIFIED and shift['compared'] <= COMPARED)


COMMANDS = (
    ('test_rig[auto]', '`identify_bag --close-loop`, a minute of the rig at 500 Hz: two cylinders and the force', 4.0),
    ('test_rig[linear]', 'the same with `--core linear`', 2.5),
    (
        'test_measured[O-ring257_3bar-auto]',
        '`identify_bag --close-loop`, `O-ring257_3bar`, a measured minute at 100 Hz',
        None,
    ),
    ('test_measured[O-ring257_3bar-linear]', '`O-ring257_3bar` with `--core linear`', 2.5),
    ('test_measured[Kidney_2bar-auto]', '`identify_bag --close-loop`, `Kidney_2bar`, with more effects', 8.0),
    ('test_measured[Kidney_2bar-linear]', '`Kidney_2bar` with `--core linear`', 6.0),
    (
        'test_law[out_and_back]',
        '`identify_bag --close-loop`, a device with an unknown characteristic, out and back',
        8.0,
    ),
    (
        'test_law[surface_following]',
        '`identify_bag --close-loop`, a device with an unknown characteristic, along a surface',
        8.0,
    ),
    ('test_plan', '`plan_experiment`', 3.0),
    ('test_help[identify_bag]', '`identify_bag --help`', 0.3),
    ('test_help[sim_node]', '`sim_node --help`', 0.3),
    ('test_ready[sim_node]', '`sim_node`, ready, warm caches', 1.0),
    ('test_ready[monitor_node]', '`monitor_node`, ready, warm caches', 1.0),
    ('test_first_start[1]', '`sim_node`, ready, first start', 8.0),
    ('test_first_start[5]', 'five `sim_node` at once, ready, first start', 8.0),
    ('test_compile_kernels', '`compile_kernels`', None),
)
"""Benchmarks of whole commands, their titles, and their promised number of units."""


MINUTES = ('leakage-60', 'valve_dead_band-12', 'sensor_lag-3', 'heat_transfer-7')
QUARTER = 'test_close_loop[leakage-60-900.0]'


def _minute_closed(run: Run) -> Outcome:
    seconds = [run.fastest(f'test_close_loop[{case}-60.0]') for case in MINUTES]
    return Outcome(f'{" / ".join(f"{second:.2f}" for second in seconds)} s with four effects', max(seconds) <= 1.0)


def _cores_used(run: Run) -> Outcome:
    minute = min(run.extra_values(f'test_close_loop[{case}-60.0]')['cores'] for case in MINUTES)
    quarter = run.extra_values(QUARTER)['cores']
    text = f'{quarter:.2f} busy over 15 min, {minute:.2f} at least over 60 s'
    return Outcome(text, min(minute, quarter) >= LEAST_BUSY_CORES)


BAGS = ('mcap', 'mcap, zstd', 'sqlite3')


def _reading_against_rosbags(run: Run) -> Outcome:
    count = run.extra_values(f'test_reading[{BAGS[0]}]')['messages']
    pairs = [(run.fastest(f'test_reading[{bag}]'), run.fastest(f'test_reading_with_rosbags[{bag}]')) for bag in BAGS]
    ratios = [their_time / our_time for our_time, their_time in pairs]
    here, there = (' / '.join(f'{1e9 * seconds / count:,.0f}' for seconds in durations) for durations in zip(*pairs))
    kinds = ' / '.join(bag.replace(',', ' with') for bag in BAGS)
    text = f'{" / ".join(f"{ratio:.3g}" for ratio in ratios)} times ({here} ns a message): {kinds}, {count:,}'
    return Outcome(text, min(ratios) >= 2.5, f'rosbags: {there} ns')


def _writing_against_rosbags(run: Run) -> Outcome:
    """Return the ratio of the time of rosbags, which gets finished messages, to the package's time."""
    count = run.extra_values('test_writing[mcap]')['messages']
    here, there = (run.fastest(f'{test}[mcap]') for test in ('test_writing', 'test_writing_with_rosbags'))
    text = f'{there / here:.3g} times ({1e9 * here / count:,.0f} ns a message): mcap, {count:,}'
    return Outcome(text, there >= 20.0 * here, f'rosbags: {1e9 * there / count:,.0f} ns')


def _reading_held(run: Run) -> Outcome:
    largest = [run.growth(f'read_{storage}')[-1:] for storage in ('mcap', 'sqlite3')]
    if not all(largest):
        raise NotMeasured('test_growth')
    pairs = [(cost['peak'], BYTES_PER_MESSAGE * cost['size']) for (cost,) in largest]
    text = ' / '.join(f'{_bytes(peak)}, arrays {_bytes(arrays)}' for peak, arrays in pairs)
    return Outcome(f'{text}: mcap / sqlite3', all(peak <= arrays + ROOM for peak, arrays in pairs))


SIM_NODE, PEER = 'test_sim_node', 'test_timer_and_default_executor'
PHYSICAL = 'test_sim_node_with_the_physical_core'
TIMER = 'a timer and the default executor'


def _answered(run: Run) -> Outcome:
    here, there = run.extra_values(SIM_NODE), run.extra_values(PEER)
    kept = None if here['lost'] == 0 and here['seconds'] < LEAST_LIVE_DURATION else here['lost'] == 0
    return Outcome(
        f'{here["lost"]:,} of {here["sent"]:,} unanswered in {here["seconds"]:g} s',
        kept,
        f'{TIMER}: {there["lost"]:,} unanswered',
    )


def _core(run: Run) -> Outcome:
    here, there = run.extra_values(SIM_NODE)['core'], run.extra_values(PEER)['core']
    return Outcome(f'{100 * here:.1f} %', here <= 0.2, f'{TIMER}: {100 * there:.1f} %')


def _of_physics(run: Run) -> Outcome:
    ratio = run.extra_values(PHYSICAL)['core'] / run.extra_values(SIM_NODE)['core']
    return Outcome(f'{ratio:.2f} times', ratio <= MOST_PHYSICAL_COST, 'without it')


def _late(run: Run) -> Outcome:
    here, there = run.extra_values(SIM_NODE)['latency_p99'], run.extra_values(PEER)['latency_p99']
    return Outcome(_duration(here), here <= 1e-3, f'{TIMER}: {_duration(there)}')


def _start(run: Run) -> Outcome:
    values = run.extra_values('test_start')
    ready, answered = values['ready'], values['answered']
    text = f'ready after {np.median(ready):.2f} s, first answers received after {np.median(answered):.2f} s'
    return Outcome(f'{text}; of {len(answered)} at most {max(answered):.2f} s', max(answered) <= 1.5)


def _plant(run: Run) -> Outcome:
    alone, together = (run.fastest(f'test_a_plant[{workers}]') for workers in (1, 2))
    efficiency = alone / (2.0 * together)
    return Outcome(f'{efficiency:.2f} ({alone:.1f} s and {together:.1f} s for 200 bags)', efficiency >= 0.85)


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
    Promise('close the loop: cores', f'both used ({LEAST_BUSY_CORES:g} busy at least)', _cores_used),
    Promise('read a bag into arrays', 'at least 2.5 times as fast', _reading_against_rosbags),
    Promise('read a bag into arrays: memory', f'the arrays and a chunk ({_bytes(ROOM)})', _reading_held),
    Promise('write a bag', 'at least 20 times as fast', _writing_against_rosbags),
    Promise('`sim_node` at 1 kHz: answers', 'all answered for 10 minutes', _answered),
    Promise('`sim_node` at 1 kHz: processor', 'at most 20 % of a core', _core),
    Promise('`sim_node` at 1 kHz, physical core: processor', f'at most {MOST_PHYSICAL_COST:g} times', _of_physics),
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


def outcomes_of(run: Run) -> list[tuple[Promise, Outcome]]:
    """Return each promise with its outcome in a run."""
    lines = []
    for promise in PROMISES:
        try:
            outcome = promise.read_outcome(run)
        except NotMeasured:
            outcome = Outcome('not measured', None)
        lines.append((promise, outcome))
    return lines


def document(run: Run, notes: str) -> str:
    """Return the document as Markdown."""
    sections = [
        '# Speed\n\nWhat does each task cost, compared with promises and with a peer in the same run? '
        'Written by `make speed-document`; the section "Notes" at the end is kept.',
        _how_section(run),
        _commands_section(run),
        _promises_section(outcomes_of(run)),
        _growth_section(run),
    ]
    return '\n\n'.join([*sections, notes]).rstrip() + '\n'


def _how_section(run: Run) -> str:
    load = run.about['load']
    libraries = ', '.join(f'{name} {version}' for name, version in run.about['libraries'].items())
    return f"""## How it was measured

- Commands: `make benchmark`, `make speed-document`. `CFD_PNEUMATIC_SECONDS=600`, \
`CFD_PNEUMATIC_MESSAGES=10000000` and `CFD_PNEUMATIC_SAMPLES={SHIFT}` measure nodes, bags and growth for longer.
- Machine: {run.about['machine']}
- Libraries: {libraries}
- Commit {run.about['commit']}; load of the machine (mean number of running processes) {load['before']:.1f} before, \
{load['after']:.1f} after"""


def _commands_section(run: Run) -> str:
    cells, steps = [], []
    for name, work, most in COMMANDS:
        try:
            values = run.extra_values(name)
        except NotMeasured:
            cells.append([work, 'not measured', '', '' if most is None else f'{most:g}', ''])
            continue
        kept = '' if most is None else 'yes' if values['units'] <= most else '**no**'
        units = f'{values["units"]:.2f}'
        cells.append([work, _duration(values['seconds']), units, '-' if most is None else f'at most {most:g}', kept])
        if 'stages' in values:
            steps.append(
                f'- `{name.removeprefix("test_")}`: '
                + '; '.join(f'{begin:.2f} s {stage}' for stage, begin in values['stages'])
            )
    return (
        '## Whole commands\n\nMedian time of five separate processes. A unit is the time of `import numba, '
        'scipy.optimize, matplotlib.pyplot` in the same run.\n\n'
        + table(['command', 'wall', 'units', 'promised', 'kept'], cells)
        + '\n\nBegin of each stage; interpreter and imports come first:\n\n'
        + '\n'.join(steps)
    )


def _promises_section(lines: Sequence[tuple[Promise, Outcome]]) -> str:
    answers = {True: 'yes', False: '**no**', None: ''}
    cells = [
        (promise.work, outcome.measured, promise.limit, outcome.peer, answers[outcome.kept])
        for promise, outcome in lines
    ]
    return (
        '## Promises\n\nTimes of the fastest rounds. The cost of a sample is judged from 3,600 samples on. *Kept* is '
        'empty if the run is too short.\n\n' + table(['work', 'measured', 'promised', 'peer', 'kept'], cells)
    )


def _growth_section(run: Run) -> str:
    cells = []
    for work, title in GROWN.items():
        for cost in run.growth(work):
            seconds, size = cost['seconds'], cost['size']
            costs = [
                _duration(seconds),
                _duration(seconds / size),
                f'{cost["busy"] / seconds:.1f}',
                _bytes(cost['peak']),
            ]
            cells.append([title, f'{size:,}', *costs])
            title = ''
    return (
        '## Growth\n\nEach size is measured in a separate process. Memory is in addition to interpreter and libraries. '
        'Arrays of more than 8 million samples are in files; only their part in memory counts.\n\n'
        + table(['work', 'samples', 'time', 'each', 'cores busy', 'memory'], cells)
    )


# the program


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the document; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    figures = ROOT / 'build' / 'benchmark.json'
    parser.add_argument(
        '--benchmark', type=Path, nargs='+', default=[figures], help='files of figures of make benchmark'
    )
    parser.add_argument('--output', type=Path, default=DOCUMENT, help='document to write')
    options = parser.parse_args(arguments)
    try:
        run = Run(*(json.loads(path.read_text(encoding='utf-8')) for path in options.benchmark))
    except (OSError, ValueError) as error:
        print(f'speed_document: the figures cannot be read ({error}). Run make benchmark first.', file=sys.stderr)
        return 2
    write_text(options.output, document(run, notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
