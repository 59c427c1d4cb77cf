# SPDX-License-Identifier: Apache-2.0
"""The document of speed: promises judged by what was measured."""

from __future__ import annotations

import json

import pytest

from studies.documents import speed as document
from studies.documents.speed import Run

SAMPLES = {350: 3.5e-6, 3_600: 18e-6, 3_600_000: 18e-3}
MESSAGES = 1_000_000
READ = 'test_growth[read_mcap-10000000]'
IDENTIFY = 'test_growth[identify_bag-14400000]'
GROWN = (
    ('fit', 1_000_000, 40),
    ('fit', 3_600_000, 45),
    ('read_mcap', 10_000_000, 17),
    ('read_sqlite3', 10_000_000, 17),
    ('identify_bag', document.SHIFT, 270),
)


def benchmarks() -> dict[str, tuple[float, dict]]:
    """Return times and what is told beside them of a run that keeps every promise, by the benchmarks' names."""
    found: dict[str, tuple[float, dict]] = {}
    for samples, seconds in SAMPLES.items():
        found[f'test_simulation[{samples}]'] = (seconds, {})
        found[f'test_simulation_of_irregular_times[{samples}]'] = (2.0 * seconds, {})
        found[f'test_simulation_with_sensitivities[{samples}]'] = (4.0 * seconds, {})
        found[f'test_fit[{samples}]'] = (60.0 * seconds, {})
        found[f'test_simulation_by_solve_ivp[{samples}]'] = (3000.0 * seconds, {})
        errors = {'exact': 1e-14, 'irregular': 2e-13, 'solve_ivp': 1e-6}
        found[f'test_simulation_to_thirty_digits[{samples}]'] = (1.0, {'errors_psi': errors})
        found[f'test_fit_by_casadi[{samples}]'] = (1500.0 * seconds, {})
    found['test_ten_thousand_parameter_sets'] = (0.02, {})
    for effect in document.MINUTES:
        found[f'test_close_loop[{effect}-60.0]'] = (0.8, {'cores': 1.8})
    found[document.QUARTER] = (9.0, {'cores': 1.9})
    for bag in document.BAGS:
        found[f'test_reading[{bag}]'] = (0.2, {'messages': MESSAGES})
        found[f'test_reading_with_rosbags[{bag}]'] = (8.0, {'messages': MESSAGES})
    for storage in ('mcap', 'sqlite3'):
        found[f'test_writing[{storage}]'] = (0.1, {'messages': MESSAGES})
        found[f'test_writing_with_rosbags[{storage}]'] = (2.5, {'messages': MESSAGES})
    for name, _, most in document.COMMANDS:
        found[name] = (1.0, {'seconds': 1.0, 'units': most or 20.0, 'stages': [('reading', 0.5), ('ended', 1.0)]})
    for work, size, bytes_each in GROWN:
        cost = {'size': size, 'seconds': 1e-6 * size, 'busy': 2e-6 * size, 'peak': bytes_each * size}
        found[f'test_growth[{work}-{size}]'] = (5.0, {**cost, 'compared': 4e8})
    live = {'sent': 600_000, 'lost': 0, 'seconds': 600.0, 'core': 0.15, 'latency_p99': 4e-4}
    found[document.SIM_NODE] = (600.0, live)
    found[document.PHYSICAL] = (600.0, {**live, 'core': 0.17})
    found[document.PEER] = (600.0, {**live, 'core': 0.5, 'latency_p99': 2e-3})
    found['test_start'] = (2.0, {'ready': [0.6, 0.7], 'answered': [0.7, 0.8]})
    found['test_a_plant[1]'], found['test_a_plant[2]'] = (30.0, {}), (16.0, {})
    return found


def told(**changes: tuple[float, dict] | None) -> dict:
    """Return a run as pytest-benchmark tells it, with benchmarks changed or left out."""
    found = {**benchmarks(), **changes}
    rows = [
        {'name': name, 'stats': {'min': one[0]}, 'extra_info': one[1]} for name, one in found.items() if one is not None
    ]
    about = {'machine': 'a machine', 'commit': '1234567', 'libraries': {'numpy': '2.0'}}
    return {**about, 'load': {'before': 0.1, 'after': 1.2}, 'machine_info': {'node': 'secret'}, 'benchmarks': rows}


def verdicts(run: dict) -> dict[str, bool | None]:
    """Return for each work whether its promise is kept."""
    lines = document.outcomes_of(Run(run))
    return {
        f'{promise.work}; {promise.limit}; {outcome.peer.partition(":")[0]}': outcome.kept for promise, outcome in lines
    }


def test_a_run_that_keeps_every_promise():
    said = verdicts(told())
    assert len(said) == len(document.PROMISES)
    assert all(said.values())
    assert '**no**' not in document.document(Run(told()), '')


@pytest.mark.parametrize(
    ('name', 'worse', 'work'),
    [
        ('test_simulation[3600000]', (30e-3, {}), 'simulate, uniform step'),
        ('test_simulation_of_irregular_times[3600000]', (44e-3, {}), 'simulate, any times'),
        ('test_simulation_by_solve_ivp[350]', (6e-3, {}), 'simulate, against a peer'),
        ('test_ten_thousand_parameter_sets', (0.07, {}), '10,000 parameter sets'),
        ('test_fit_by_casadi[350]', (3e-3, {}), 'fit four parameters; at least 20 times; CasADi'),
        ('test_fit[3600000]', (1.6, {}), 'fit four parameters, 1 h at 1 kHz;'),
        ('test_close_loop[sensor_lag-3-60.0]', (1.1, {'cores': 1.8}), 'close the loop, 60 s'),
        (document.QUARTER, (9.0, {'cores': 1.0}), 'close the loop: cores'),
        ('test_reading_with_rosbags[sqlite3]', (0.4, {'messages': MESSAGES}), 'read a bag into arrays; at least'),
        ('test_writing_with_rosbags[mcap]', (1.9, {'messages': MESSAGES}), 'write a bag; at least'),
        (READ, (5.0, {'size': 10**7, 'peak': 2e8}), 'read a bag into arrays: memory'),
        (IDENTIFY, (9.0, {'size': document.SHIFT, 'peak': 5e9, 'compared': 1e8}), 'identify a bag of 4 h'),
        (IDENTIFY, (9.0, {'size': document.SHIFT, 'peak': 3e9, 'compared': 6e8}), 'identify a bag of 4 h'),
        ('test_start', (2.0, {'ready': [0.6, 0.7], 'answered': [0.7, 1.8]}), 'start of `sim_node`'),
        ('test_a_plant[2]', (20.0, {}), 'a plant'),
    ],
)
def test_a_promise_that_is_missed(name, worse, work):
    missed = [one for one, kept in verdicts(told(**{name: worse})).items() if kept is False]
    assert len(missed) == 1
    assert missed[0].startswith(work)


def test_answers_count_when_they_were_watched_long_enough():
    live = benchmarks()[document.SIM_NODE][1]
    short, lost = {**live, 'seconds': 10.0}, {**live, 'seconds': 10.0, 'lost': 3}

    def said(extra: dict) -> bool | None:
        found = verdicts(told(**{document.SIM_NODE: (10.0, extra)}))
        return next(kept for work, kept in found.items() if work.startswith('`sim_node` at 1 kHz: answers'))

    assert [said(one) for one in (live, short, lost)] == [True, None, False]


def test_the_document_says_what_is_missed_and_what_was_not_measured(tmp_path):
    run, output = tmp_path / 'benchmark.json', tmp_path / 'speed.md'
    slow = {'test_plan': (3.1, {'seconds': 3.1, 'units': 3.1}), 'test_rig[auto]': None}
    run.write_text(json.dumps(told(**{'test_fit[3600000]': (1.75, {}), 'test_a_plant[1]': None, READ: None, **slow})))
    output.write_text('# Old\n\n## Notes\n\nBy hand.\n')
    assert document.main(['--benchmark', str(run), '--output', str(output)]) == 0
    text = output.read_text()
    assert '| fit four parameters, 1 h at 1 kHz | 1.75 s | at most 1.5 s | - | **no** |' in text
    assert '| a plant: efficiency of 2 workers | not measured |' in text
    assert '| read a bag into arrays: memory | not measured |' in text
    assert (
        '| fit four parameters | 1,000,000 | 1 s | 1 us | 2.0 | 38 MiB |\n|  | 3,600,000 | 3.6 s | 1 us | 2.0 |' in text
    )
    assert 'Commit 1234567; load' in text
    assert text.endswith('## Notes\n\nBy hand.\n')
    assert 'secret' not in text
    tables = [block for block in text.split('\n\n') if block.startswith('|')]
    assert len(tables) == 3
    assert '| `plan_experiment` | 3.1 s | 3.10 | at most 3 | **no** |' in text
    assert (
        '| `identify_bag --close-loop`, a minute of the rig at 500 Hz: two cylinders and the force | not measured |'
        in text
    )
    for block in tables:
        assert len({line.count('|') for line in block.splitlines()}) == 1, block


def test_without_figures_it_says_how_to_get_them(tmp_path, capsys):
    assert document.main(['--benchmark', str(tmp_path / 'none.json'), '--output', str(tmp_path / 'speed.md')]) == 2
    assert 'Run make benchmark first' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
