# SPDX-License-Identifier: Apache-2.0
"""The panel's benchmark: what counts as right, the document, and that a run goes on where it was stopped."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import pytest

from studies.panel import LIBRARY, MAKES, ON_COMMAND, ON_FORCE, WEAK_ON_COMMAND, benchmark_effects
from studies.panel import document as panel_document
from studies.panel import rows as panel_rows
from studies.panel import scores as panel_scores
from studies.panel.rows import Job, Row
from studies.panel.scores import RIGHT, Share
from studies.tools import provenance

LEAK = Row(
    'effects',
    ('leakage',),
    'out_and_back',
    1000,
    verdict='effect_added',
    named=('leakage',),
    before=3.0,
    after=1.0,
    before_test=3.1,
    after_test=1.02,
    tested=True,
    noise=0.99,
    seconds=1.5,
    code='abc',
    commit='1234567',
)
PAIR = replace(
    LEAK,
    kind='pairs',
    effects=('leakage', 'sensor_lag'),
    named=('sensor_lag', 'leakage'),
    errors_without={'leakage': 1.9, 'sensor_lag': 2.0},
)

RUBS = replace(LEAK, kind='force', effects=('seal_friction',), named=('seal_friction',))


def alternative(true: str, first: str) -> Row:
    """Return an answer that has the true effect among its alternatives."""
    return replace(LEAK, effects=(true,), named=(first,), alternatives={first: (true,)})


@pytest.mark.parametrize(
    ('row', 'answer'),
    [
        (LEAK, 'right'),
        (replace(LEAK, named=('leakage', 'droop')), 'right'),
        (replace(LEAK, verdict='unexplained'), 'right'),
        (alternative('transport_delay', 'sensor_lag'), 'listed alternative'),
        (alternative('lost_motion', 'valve_hysteresis'), 'listed alternative'),
        (alternative('leakage', 'sensor_lag'), 'unlisted alternative'),
        (
            replace(RUBS, named=('moving_mass',), alternatives={'moving_mass': ('seal_friction',)}),
            'unlisted alternative',
        ),
        (replace(RUBS, named=('stribeck_friction',), alternatives={'stribeck_friction': RUBS.effects}), RIGHT[1]),
        (replace(LEAK, named=('droop',)), 'wrong name'),
        (replace(LEAK, named=('droop', 'leakage')), 'wrong name'),
        (replace(LEAK, verdict='no_missing_effect', named=()), 'no name'),
        (replace(LEAK, verdict='refused', named=()), 'no name'),
    ],
)
def test_the_first_name_answers(row, answer):
    assert panel_scores.answer(row) == answer


def test_pairs_are_listed_both_ways_and_only_within_a_family():
    assert panel_scores.is_listed_pair('droop', 'leakage')
    assert panel_scores.is_listed_pair('droop', 'sensor_lag')
    assert panel_scores.is_listed_pair('sensor_lag', 'droop')
    assert not panel_scores.is_listed_pair('leakage', 'sensor_lag')
    assert {name for _, names in panel_scores.GROUPS for name in names} <= {*LIBRARY, *ON_FORCE, *ON_COMMAND}


def test_effects_that_are_not_visible_do_not_count():
    hidden = replace(LEAK, before=1.15, named=(), verdict='no_missing_effect')
    assert LEAK.visible
    assert not hidden.visible
    assert replace(LEAK, before=math.nan, verdict='refused').visible, 'a refused recording counts as visible'
    assert PAIR.both_visible
    assert not replace(PAIR, errors_without={'leakage': 1.01, 'sensor_lag': 2.0}).both_visible
    (goal, *_) = panel_scores.goals([LEAK, LEAK, hidden])
    assert (goal.recordings, goal.met) == (2, True)


@pytest.mark.parametrize(
    ('named', 'alternatives', 'strictly', 'with_alternatives'),
    [
        (('sensor_lag', 'leakage'), {}, True, True),
        (('sensor_lag', 'leakage', 'droop'), {}, True, True),
        (('sensor_lag',), {}, False, False),
        (('sensor_lag', 'droop'), {'droop': ('leakage',)}, False, True),
        (('sensor_lag', 'heat_transfer'), {'heat_transfer': ('leakage',)}, False, False),
        (('droop',), {'droop': ('leakage', 'sensor_lag')}, False, False),
    ],
)
def test_both_effects_of_a_pair_are_found(named, alternatives, strictly, with_alternatives):
    row = replace(PAIR, named=named, alternatives=alternatives)
    assert panel_scores.found_both(row) is strictly
    assert panel_scores.found_both(row, alternatives=True) is with_alternatives


def test_shares_have_wilsons_interval():
    """As tables have it: 15 of 20."""
    assert Share(15, 20).interval == pytest.approx((0.5313, 0.8881), abs=1e-4)
    assert Share(0, 10).interval == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert str(Share(15, 20)) == '75.0 % (15/20; 53 to 89)'
    assert str(Share(0, 0)) == '-'


def test_goals_are_compared_with_measured_values():
    rows = [
        LEAK,
        replace(LEAK, effects=('droop',), named=('heat_transfer',), after_test=1.5),
        replace(LEAK, kind='foreign', effects=('mains_hum',), named=(), verdict='unexplained'),
        replace(LEAK, kind='clean', effects=('white',), named=(), verdict='no_missing_effect', before=1.0),
        PAIR,
        replace(PAIR, named=('sensor_lag', 'leakage', 'droop')),
        RUBS,
        replace(RUBS, kind='clean_force', effects=()),
    ]
    found = {goal.description: goal for goal in panel_scores.goals(rows)}

    def met(start: str) -> bool:
        return next(goal.met for description, goal in found.items() if description.startswith(start))

    assert not met('right name first')
    assert not met('test error after')
    assert met("the report's noise floor")
    assert met('clean')
    assert met('effects outside')
    assert met('two effects: both')
    assert met('contact force: right')
    assert not met('contact force of healthy')
    assert not met('two effects: exactly')


def test_the_document_has_a_line_for_each_effect():
    hidden = replace(LEAK, before=1.0, named=('droop',))
    refused = Row('effects', ('heat_transfer',), 'out_and_back', 7, verdict='refused', why='ValueError: NaN')
    rows = [LEAK, hidden, alternative('sensor_lag', 'droop'), refused, PAIR]
    rows += [replace(PAIR, named=('droop',), seed=1001), replace(PAIR, verdict='not_drawn', seed=1002)]
    rows += [replace(LEAK, kind=kind, effects=('mains_hum',)) for kind in ('foreign',)]
    rows += [replace(LEAK, kind='clean', effects=('coloured',))]
    rows += [RUBS, replace(RUBS, kind='clean_force', effects=(), named=())]
    rows += [LATE, replace(LATE, kind='weak_command', named=('droop',), not_visible=LATE.effects)]
    how = {'command': 'make benchmark-effects', 'machine': 'a machine'}
    text = panel_document.document(rows, how, '## Notes\n\nBy hand.')
    assert '| `leakage` | 2 | 1 (droop 1) | 1 | 1 | 0 | 0 | 0 / 0 / 0 |' in text
    assert '| `sensor_lag` | 1 | 0 | 1 | 0 | 1 | 0 | 0 / 0 / 0 |' in text
    assert '| `heat_transfer` | 1 | 0 | 1 | 0 | 0 | 0 | 0 / 0 / 1 |' in text
    assert '| `out_and_back` | `seal_friction` | 1 | 0 | 1 | 1 |' in text
    assert 'Of 1 recordings of devices with no effect 0 get a name, 0 end' in text
    late = '`out_and_back` | `setpoint_delay` + `setpoint_lag` | 1 |'
    assert f'| `command` | {late} 100.0 % (1/1; 21 to 100) | 100.0 % (1/1; 21 to 100) | 0 |' in text
    assert f'| `weak_command` | {late} 0.0 % (0/1; 0 to 79) | 100.0 % (1/1; 21 to 100) | 1 |' in text
    assert 'ValueError: NaN' in text
    assert '1 pairs' in text
    assert 'commit 1234567 (program text abc)' in text
    assert text.endswith('## Notes\n\nBy hand.\n')
    tables = [block for block in text.split('\n\n') if block.startswith('|')]
    assert len(tables) >= 8
    for block in tables:
        assert len({line.count('|') for line in block.splitlines()}) == 1, block


def test_rows_come_back_from_disk(tmp_path):
    path = tmp_path / 'rows.jsonl'
    lines = [json.dumps(asdict(row)) for row in (LEAK, PAIR, replace(LEAK, seed=2, code='other'))]
    path.write_text('\n'.join([*lines, '{"kind": "effects"}', lines[0][:40]]))
    assert panel_rows.read_rows(path, 'abc') == {LEAK.job: LEAK, PAIR.job: PAIR}
    assert len(panel_rows.read_rows(path, None)) == 3
    assert panel_rows.read_rows(tmp_path / 'none.jsonl', 'abc') == {}


def test_a_run_goes_on_where_it_was_stopped(tmp_path, monkeypatch, capsys):
    measured = []

    def measure(job: Job) -> Row:
        if len(measured) == 4:
            raise KeyboardInterrupt
        measured.append(job)
        return replace(LEAK, **job._asdict(), verdict='no_missing_effect', named=(), before=1.0)

    monkeypatch.setattr(panel_rows, 'measure', measure)
    output, rows = tmp_path / 'panel.md', tmp_path / 'build' / 'rows.jsonl'
    output.write_text('# Old\n\n## Notes\n\nBy hand.\n')
    arguments = ['--kinds', 'clean', '--seeds', '1000:1002', '--schedules', 'paper_step', '--jobs', '0']
    arguments += ['--output', str(output), '--rows', str(rows)]
    assert benchmark_effects.main(arguments) == 130
    assert len(rows.read_text().splitlines()) == 4
    first, measured[:] = list(measured), []
    assert benchmark_effects.main(arguments) == 0
    assert len({*first, *measured}) == len(first) + len(measured) == 6
    assert '6 recordings, 2 of them are not measured yet' in capsys.readouterr().out
    text = output.read_text()
    assert '| quantised | `paper_step` | 2 | 0 |' in text
    assert text.endswith('## Notes\n\nBy hand.\n')
    assert benchmark_effects.main([*arguments, '--only-document']) == 0


def test_the_recordings_of_a_run():
    jobs = panel_rows.jobs_of(['effects', 'clean', 'pairs'], ['paper_step'], lambda kind, schedule: range(1000, 1002))
    assert len(jobs) == len(set(jobs)) == 2 * (len(LIBRARY) + 3 + 1)
    assert [job.seed for job in jobs] == sorted(job.seed for job in jobs)
    jobs = panel_rows.jobs_of(['force', 'clean_force'], ['paper_step'], lambda kind, schedule: range(1))
    assert {job.effects for job in jobs} == {(), *((name,) for name in ON_FORCE)}
    some = panel_rows.jobs_of(['effects', 'foreign'], ['paper_step'], lambda kind, schedule: range(1), ['droop'])
    assert some == [Job('effects', ('droop',), 'paper_step', 0)]
    assert len({frozenset(pair) for pair in panel_rows.PAIRS}) == len(panel_rows.PAIRS) == 171


def test_set_points_that_act_late_are_drawn_where_set_points_step():
    jobs = panel_rows.jobs_of(['command', 'weak_command'], panel_rows.SCHEDULES, lambda kind, schedule: range(2))
    assert {job.schedule for job in jobs} == {'out_and_back', 'surface_following'}
    assert {job.effects for job in jobs} == {('setpoint_delay',), ('setpoint_lag',), ('setpoint_delay', 'setpoint_lag')}
    assert len(jobs) == 2 * 2 * 2 * 3
    assert panel_rows.given_strengths('command', ('setpoint_lag',), 0) == {}
    given = [panel_rows.given_strengths('weak_command', tuple(ON_COMMAND), seed) for seed in range(200)]
    for name in ON_COMMAND:
        drawn = [strengths[name] for strengths in given]
        assert WEAK_ON_COMMAND[0] <= min(drawn) < 0.0015
        assert 0.0100 < max(drawn) <= WEAK_ON_COMMAND[1]


LATE = replace(
    LEAK, kind='command', effects=('setpoint_delay', 'setpoint_lag'), named=('setpoint_delay', 'setpoint_lag')
)


@pytest.mark.parametrize(
    ('row', 'is_named', 'is_named_or_hidden'),
    [
        (LATE, True, True),
        (replace(LATE, named=('setpoint_lag',)), False, False),
        (replace(LATE, named=('setpoint_lag',), not_visible=('setpoint_delay',)), False, True),
        (replace(LATE, named=('droop',), alternatives={'droop': ('setpoint_delay', 'setpoint_lag')}), True, True),
        (replace(LATE, named=('leakage',), alternatives={'leakage': ('setpoint_delay', 'setpoint_lag')}), False, False),
        (replace(LATE, named=(), not_visible=('setpoint_delay', 'setpoint_lag')), False, True),
        (replace(LATE, named=(), not_visible=('setpoint_delay',)), False, False),
    ],
)
def test_each_reason_of_a_late_set_point_is_accounted_for(row, is_named, is_named_or_hidden):
    assert panel_scores.accounts_for_each(row) is is_named
    assert panel_scores.accounts_for_each(row, hidden=True) is is_named_or_hidden
    goals = panel_scores.goals([row, replace(row, kind='weak_command')])
    assert [goal.met for goal in goals if 'acts' in goal.description] == [is_named, is_named_or_hidden]


@pytest.mark.parametrize('effects', [('force_offset',), ()])
def test_the_contact_force_is_measured(effects):
    row = panel_rows.measure(Job('force' if effects else 'clean_force', effects, 'out_and_back', 45))
    assert row.named == effects
    assert row.verdict == ('effect_added' if effects else 'no_missing_effect')
    assert row.visible is bool(effects)
    assert row.after_test == pytest.approx(1.0, abs=0.05)
    assert row.noise == pytest.approx(1.0, abs=0.1)


def test_every_make_has_its_turn_with_what_is_not_its_physics():
    jobs = panel_rows.jobs_of(['whole', 'healthy_whole'], ['out_and_back'], lambda kind, schedule: range(5000, 5007))
    assert {panel_rows.make_of(job.kind, job.seed) for job in jobs} == set(MAKES)
    effects = {job.effects for job in jobs}
    assert () in effects
    assert {('operating_point',), ('volume_variation',), ('heat_transfer',)}.isdisjoint(effects)
    assert len(jobs) == 7 * (len(LIBRARY) - 3 + 1)
    assert panel_rows.make_of('effects', 5000) is None


@pytest.mark.parametrize(
    ('row', 'is_among', 'is_whole'),
    [
        (LEAK, True, True),
        (replace(LEAK, named=('droop', 'leakage')), True, False),
        (replace(LEAK, verdict='unexplained'), True, False),
        (replace(LEAK, after_test=1.2), True, False),
        (replace(LEAK, named=('droop',), alternatives={'droop': ('leakage',)}), True, True),
        (replace(LEAK, named=('sensor_lag',), alternatives={'sensor_lag': ('leakage',)}), False, False),
        (replace(LEAK, named=(), verdict='no_missing_effect'), False, False),
    ],
)
def test_a_whole_answer_is_one_name_noise_and_the_floor(row, is_among, is_whole):
    assert panel_scores.is_among_names(row) is is_among
    assert panel_scores.is_whole(row) is is_whole


def test_devices_with_all_of_their_physics_have_goals_of_their_own():
    rows = [replace(LEAK, kind='whole', seed=5000 + index) for index in range(7)]
    rows += [replace(LEAK, kind='healthy_whole', effects=(), named=(), verdict='no_missing_effect')]
    assert all(goal.met for goal in panel_scores.goals(rows))
    blamed = [*rows, replace(rows[-1], named=('leakage',), verdict='effect_added')]
    assert not all(goal.met for goal in panel_scores.goals(blamed))
    text = panel_document.document(rows, {'command': 'c', 'machine': 'm'}, '## Notes')
    assert '`silencer`, own' in text


def test_the_core_is_the_baseline_of_devices_with_full_physics():
    row = panel_rows.measure(Job('healthy_whole', (), 'out_and_back', 7))
    assert (row.verdict, row.named) == ('no_missing_effect', ())
    assert row.before_test == pytest.approx(1.0, abs=0.1)


def test_a_changed_module_makes_a_version(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, 'ROOT', tmp_path)
    module = tmp_path / 'cfd_pneumatic' / 'rig' / 'module.py'
    module.parent.mkdir(parents=True)
    versions = []
    for text in ('A = 1', 'A = 1', 'A = 2'):
        module.write_text(text)
        versions.append(provenance.code_version())
    assert versions[0] == versions[1] != versions[2]


@pytest.mark.parametrize('wrong', [['--seeds', '7'], ['--kinds', 'effect'], ['--effects', 'leak']])
def test_what_is_no_choice_is_refused(wrong, capsys):
    with pytest.raises(SystemExit):
        benchmark_effects.main(wrong)
    assert wrong[0] in capsys.readouterr().err
