# SPDX-License-Identifier: Apache-2.0
"""The commands of `docs/tutorials/first_report.md`, one after the other in an empty folder, and their promises."""

from __future__ import annotations

import json
import re

import pytest
import yaml
from measured import ROOT as MEASURED
from measured import needs_measured_data

from studies.documents.tutorial import PAGE, PICTURE, blocks, run

TEXT = ' '.join(PAGE.read_text(encoding='utf-8').replace('\n> ', ' ').split())  # quoted lines, too
REAL = 'A real cylinder'


def test_the_table_looks_as_it_says(tutorial):
    head = (tutorial.folder / 'press.csv').read_text().splitlines()[:3]
    assert ' '.join(head) in TEXT
    assert 'displacement: -1.974 to 2.005 mm; 10,001 samples at 499.9 Hz' in tutorial.said['A bag']


def test_the_effect_that_nobody_declared_is_named_with_its_size(tutorial):
    said = ' '.join(tutorial.said['What the model lacks'].split())
    verdict = r'cylinder_a: (Effect found[.] Missing effect: valve dead band[.] Adding it reduces the error to) (\d+) %'
    (wording, left), (promised_wording, promised) = (re.search(verdict, text).groups() for text in (said, TEXT))
    assert wording == promised_wording
    assert float(left) == pytest.approx(float(promised), abs=2.0)
    found = [float(one) for one in re.search(r'band │ ([\d.]+) │ ([\d.]+) to ([\d.]+) │ Pa', said).groups()]
    size = [float(one) for one in re.search(r'its size, ([\d.]+) Pa \(([\d.]+) to ([\d.]+)\)', TEXT).groups()]
    assert found == pytest.approx(size, abs=1.0)
    assert size[1] < 300.0 < size[2]
    assert 'cylinder_b: Nothing missing.' in said
    assert all((tutorial.folder / 'found' / name).is_file() for name in ('report.html', 'compare.mcap', 'report.json'))
    written = yaml.safe_load((tutorial.folder / 'found' / 'parameters.yaml').read_text())['/**']['ros__parameters']
    assert written['cylinder_a']['valve_dead_band']['enabled']


def test_what_is_not_identifiable_is_planned_for(tutorial):
    said = tutorial.said['What was not identifiable, and the next experiment']
    assert re.search('k_sv +│ not identifiable', said)
    assert 'plan_experiment step/parameters.yaml' in said
    assert 'cylinder_b: Nothing missing.' in said
    for folder, unseen in ('found', ['setpoint_lag', 'setpoint_delay', 'line_restriction']), ('next_found', []):
        report = json.loads((tutorial.folder / folder / 'report.json').read_text())
        assert report['cylinders']['cylinder_b']['not_visible'] == unseen


def test_a_law_that_nobody_knows_is_drawn_and_drawn_again_over_a_larger_range(tutorial):
    said = ' '.join(tutorial.said['A law that nobody knows'].split())
    verdict = r'cylinder_a: Unknown characteristic[.] .*? the error to (\d+) %[.] The remaining error is sensor noise'
    assert re.search(verdict, said)[1] == re.search(verdict, TEXT)[1]
    assert 'cylinder_b: Nothing missing. The physical core is used' in said
    reports = [json.loads((tutorial.folder / name / 'report.json').read_text()) for name in ('bent', 'bent_again')]
    first, again = (report['cylinders']['cylinder_a']['unknown'] for report in reports)
    assert (first['enters'], first['against']) == (again['enters'], again['against']) == ('sensing', 'p')
    slope, _, place = re.fullmatch(r'([\d.]+) max\((p) - ([\d.e+]+), 0\)', first['formula']).groups()
    assert float(slope) == pytest.approx(0.1, abs=0.002)
    assert f'{float(place):.1e}' in TEXT
    reach = [one['curve']['at'][-1] - one['curve']['at'][0] for one in (first, again)]
    assert reach[1] / reach[0] > 2.0
    draft = (tutorial.folder / 'bent_sensor.py').read_text()
    assert 'max(z - b, 0.0)' in draft
    assert "EffectParameter('height', '-'" in draft
    assert "EffectParameter('place', 'Pa'" in draft


def test_nothing_that_it_wants_is_compiled_again(compiled, tutorial):
    assert tutorial.machine_code == compiled.said['machine code']


def test_every_program_that_runs_on_is_one_of_ours():
    started = [block.text.split()[0] for block in blocks() if block.language == 'bash']
    assert started == ['rig_node', 'sim_node', 'monitor_node', 'python3', 'rig_node', 'sim_node']


def test_the_picture_is_small():
    assert 20_000 < PICTURE.stat().st_size < 300_000


@pytest.mark.long
@needs_measured_data
def test_a_worn_seal_is_named(tutorial):
    (block,) = (block for block in blocks() if block.heading == REAL)
    environment = tutorial.environment | {'CFD_PNEUMATIC_DATA': str(MEASURED.parent)}
    said = ' '.join(run(block.text, tutorial.folder, environment).split())
    assert 'cylinder_a: the displacement seems to come' in said
    assert 'cylinder_a: Unexplained, with a warning: check the data first. The physical core is used' in said
    assert 'Missing effects: positional leakage' in said
    assert float(re.search(r'positional_leakage │ (\d+) %', said)[1]) == pytest.approx(90.0, abs=2.0)
    assert re.search(r'│ tau │ not identifiable', said)
