# SPDX-License-Identifier: Apache-2.0
"""The commands of the tutorials, one after the other in an empty folder, and the results that the pages state."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import yaml
from measured import ROOT as MEASURED
from measured import needs_measured_data

from studies.documents import path_picture
from studies.documents.tutorial import HOLD_THE_FORCE, OWN_DATA, PAGES, PICTURE, blocks, run
from studies.tools.provenance import ROOT

TEXT = ' '.join(' '.join(page.read_text(encoding='utf-8') for page in PAGES).replace('\n> ', ' ').split())
"""The text of all tutorials in one line, without the marks of quotations."""

NUMBER = re.compile(r'\d[\d,.]*(?<![,.])')

PREDICT_AND_HOLD = ROOT / 'docs' / 'how_to' / 'predict_and_hold_the_force.md'
INSTALL = ROOT / 'docs' / 'how_to' / 'install.md'
REAL = 'A real cylinder'


def test_the_table_looks_as_it_says(tutorial):
    head = (tutorial.folder / 'press.csv').read_text().splitlines()[:3]
    assert ' '.join(head) in TEXT
    line = 'displacement: -1.974 to 2.005 mm; 10,001 samples at 499.9 Hz in 20 s'
    assert line in tutorial.said['The mapping']
    assert line in TEXT


def test_the_effect_that_nobody_declared_is_named_with_its_size(tutorial):
    said = ' '.join(tutorial.said['The report'].split())
    verdict = r'Cylinder A: Effect found[.] Diagnosis .*? How sure Confirmed[.] .*? falls from (\d+) to ([\d.]+) Pa'
    printed, promised = (re.search(verdict, text) for text in (said, TEXT))
    assert [float(size) for size in printed.groups()] == pytest.approx(
        [float(size) for size in promised.groups()], 0.02
    )
    report = json.loads((tutorial.folder / 'found' / 'report.json').read_text())['cylinders']['cylinder_a']
    found = report['effect_parameters']['valve_dead_band']['band']
    size, spread = map(float, re.search(r'Parameters\*: (\d+) Pa ± ([\d.]+) %', TEXT).groups())
    assert found['value'] == pytest.approx(size, abs=1.0)
    assert (found['ci95'][1] / found['value'] - 1.0) * 100.0 == pytest.approx(spread, abs=0.05)
    assert found['ci95'][0] < 300.0 < found['ci95'][1]
    assert 'Cylinder B: Nothing missing.' in said
    assert all((tutorial.folder / 'found' / name).is_file() for name in ('report.html', 'compare.mcap', 'report.json'))
    written = yaml.safe_load((tutorial.folder / 'found' / 'parameters.yaml').read_text())['/**']['ros__parameters']
    assert written['cylinder_a']['valve_dead_band']['enabled']


def test_what_is_not_identifiable_is_planned_for(tutorial):
    said = tutorial.said['The next experiment']
    assert re.search('k_sv +│ not identifiable', said)
    assert 'plan_experiment step/parameters.yaml' in said
    assert 'Cylinder B: Nothing missing.' in said
    for folder, unseen in ('found', ['setpoint_lag', 'setpoint_delay', 'line_restriction']), ('next_found', []):
        report = json.loads((tutorial.folder / folder / 'report.json').read_text())
        assert report['cylinders']['cylinder_b']['not_visible'] == unseen


def test_an_unknown_characteristic_is_estimated_and_estimated_again_over_a_larger_range(tutorial):
    said = ' '.join(tutorial.said['The verdict'].split())
    verdict = r'Cylinder A: Unknown characteristic[.] .*? varies by \d+ Pa, depending on the pressure'
    assert re.search(verdict, said)[0] == re.search(verdict, TEXT)[0]
    assert 'Cylinder B: Nothing missing.' in said
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


def outputs(page):
    """Yield the heading and the text of each printed answer on a page, in one line."""
    heading = ''
    for part in re.split(r'\n\n+', re.sub(r'^```.*?^```$', '', page.read_text(encoding='utf-8'), flags=re.M | re.S)):
        heading = part.removeprefix('## ') if part.startswith('## ') else heading
        if part.startswith('    '):
            yield heading, ' '.join(part.split())


def numbers_in(text):
    return [float(number.replace(',', '')) for number in NUMBER.findall(text)]


@pytest.mark.parametrize(('heading', 'text'), outputs(HOLD_THE_FORCE), ids=lambda text: text[:20])
def test_the_answers_on_the_force_are_those_that_the_page_shows(tutorial, heading, text):
    pattern = NUMBER.sub('NUMBER', text)
    printed = ' '.join(tutorial.said[heading].split())
    found = re.search(re.escape(pattern).replace('NUMBER', NUMBER.pattern), printed)
    assert found is not None, f'{text}\nis not in\n{printed}'
    assert numbers_in(found[0]) == pytest.approx(numbers_in(text), rel=0.1, abs=0.006)


def test_the_readme_has_answers_of_the_tutorial():
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| (?:Which|How)[^|]*\? \| (.*) \|$', readme.partition('hold the force\n\n')[2], re.MULTILINE)
    page = ' '.join(HOLD_THE_FORCE.read_text(encoding='utf-8').split())
    assert len(rows[:3]) == 3
    assert all(row.rpartition(': ')[2] in page for row in rows[:3])


def test_the_lines_in_python_on_holding_the_force_run(tutorial):
    code = ''.join(block.text for block in blocks(PREDICT_AND_HOLD) if block.language == 'python')
    environment = tutorial.environment | {'MPLBACKEND': 'agg'}
    lines = run(f"python3 - <<'PYTHON'\n{code}PYTHON\n", tutorial.folder, environment).splitlines()
    assert [line for line in lines if line.startswith('Held force')]
    assert (tutorial.folder / 'preview' / 'schedule.csv').read_text().count('\n') > 2000


def test_held_setpoints_keep_the_tolerance_that_constant_ones_violate(tutorial):
    constant, held = (
        float(size) for size in re.findall(r'force error ([\d.]+) N', tutorial.said['Play both on the rig'])
    )
    assert held < 0.2 * constant
    preview = json.loads((tutorial.folder / 'held' / 'preview.json').read_text())
    assert preview['tolerance_n'] == 1.5
    assert any(violation['is_certain'] for violation in preview['constant']['violations'])
    assert preview['held']['violations'] == []


def test_nothing_that_it_wants_is_compiled_again(compiled, tutorial):
    assert tutorial.machine_code == compiled.said['machine code']


def test_every_program_that_runs_on_is_in_the_tutorial_on_the_monitor():
    started = [[block.text.split()[0] for block in blocks(page) if block.language == 'bash'] for page in PAGES]
    assert started == [[], [], [], ['rig_node', 'sim_node', 'monitor_node', 'python3']]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_every_block_of_commands_runs(page, tutorial):
    """Blocks of ``sh`` ran to their end, apart from those that need measured data."""
    headings = {block.heading for block in blocks(page) if block.language == 'sh' and block.heading != REAL}
    assert headings
    assert headings <= tutorial.said.keys()
    languages = {block.language for block in blocks(page)}
    assert languages <= {'sh', 'bash', 'console'}


def test_no_tutorial_overwrites_results_of_an_earlier_one():
    outputs = [re.findall(r'--output (\S+)', block.text) for block in blocks()]
    folders = [folder for found in outputs for folder in found]
    assert len(folders) == len(set(folders)) > 8


def test_the_page_on_the_installation_has_the_commands_of_the_readme():
    def commands(page):
        return [line for line in page.read_text(encoding='utf-8').splitlines() if line.startswith('    ')]

    readme = [line for line in commands(ROOT / 'README.md') if 'colcon' in line or 'rosdep' in line or 'pip ' in line]
    assert len(readme) == 3
    assert set(readme) <= set(commands(INSTALL))


def test_the_pictures_are_small():
    assert 20_000 < PICTURE.stat().st_size < 300_000
    assert 20_000 < path_picture.PICTURE.stat().st_size < 150_000


def test_the_picture_of_the_forces_is_that_of_the_tutorial(tutorial):
    _, forces = path_picture.plot_forces(tutorial.folder).axes
    constant, held = (np.abs(forces.lines[index].get_ydata() - 30.0) for index in (0, 2))  # as recorded
    assert np.max(constant) > 1.5
    assert np.mean(held) < 0.2 * np.mean(constant)


@pytest.mark.long
@needs_measured_data
def test_a_worn_seal_is_named(tutorial):
    (block,) = (block for block in blocks(OWN_DATA) if block.heading == REAL)
    environment = tutorial.environment | {'CFD_PNEUMATIC_DATA': str(MEASURED.parent)}
    said = ' '.join(run(block.text, tutorial.folder, environment).split())
    assert 'warning: cylinder_a: the displacement lags the pressure by' in said
    assert 'Cylinder A: Unexplained, with a warning: check the data first.' in said
    report = json.loads((tutorial.folder / 'kidney' / 'report.json').read_text())['cylinders']['cylinder_a']
    assert report['effects'][0] == 'positional_leakage'
    first = next(trial for trial in report['tried'] if trial['effect'] == 'positional_leakage' and trial['accepted'])
    assert 100.0 * first['rss_drop'] == pytest.approx(90.0, abs=2.0)
    assert not report['parameters_after']['tau']['identifiable']
