# SPDX-License-Identifier: Apache-2.0
"""`index.html`: what it says, and what a real browser makes of it."""

from __future__ import annotations

import re
from functools import cache
from urllib.parse import unquote

import pytest
from generated import BAGS, FIRST, SHIFT
from identified import closed, with_force

from cfd_pneumatic.charts import shared_scripts
from cfd_pneumatic.plant.index_page import index_page, verdict_description
from cfd_pneumatic.plant.job import failed_row, report_rows
from cfd_pneumatic.plant.result_table import column_of
from cfd_pneumatic.reporting import report_data

OVERFLOWING = """
[...document.querySelectorAll('table, figure, summary, dl')].filter(one => one.scrollWidth > one.clientWidth + 1).length
"""
OPEN_ALL = "document.querySelectorAll('details').forEach(one => { one.open = true; })"


@cache
def report():
    return report_data(with_force(closed()))


def rows_for(devices, shifts):
    """Return rows of a plant: droop in cylinder A of all, which appears half-way in cell_1; its last bag fails."""
    rows = []
    for device in range(1, devices + 1):
        for shift in range(shifts):
            about = {'device': f'cell_{device}', 'bag': f'plant/cell_{device}/shift_{shift}.mcap'}
            if device == 1 and shift == shifts - 1:
                rows.append({**about, **failed_row('is damaged: <b>badly</b>')})
                continue
            for row in report_rows(report(), FIRST + shift * SHIFT, f'cell_{device}/shift_{shift}/report.html'):
                if device == 1 and shift < shifts // 2 and row['part'] == 'cylinder_a':
                    gone = {'effects': '', 'alternatives': '', 'effect_parameters': None}
                    row = {**row, **gone, 'verdict': 'no_missing_effect'}
                rows.append({**row, **about})
    return rows


@pytest.fixture(scope='module')
def page():
    return index_page(rows_for(12, 6))


def text_of(page):
    body = re.sub(r'<style>.*?</style>|<svg.*?</svg>', '', page, flags=re.DOTALL)
    return ' '.join(re.sub(r'<[^>]+>', ' ', body).split())


def test_the_sums_come_first(page):
    assert re.search(r'devices 12 bags 72 device changed 1 bags failed 1', text_of(page))


def test_what_every_device_shows_is_the_set_ups(page):
    shown = r'Every device shows droop \(slope 0.00138 s, lag .* s\) and seal friction .* A common finding'
    assert re.search(shown, text_of(page))
    rows = rows_for(12, 6)
    last = next(row for row in reversed(rows) if row['part'] == 'cylinder_a')
    last['effect_parameters'] = last['effect_parameters'].replace(
        '"droop.lag": {"value": 0.', '"droop.lag": {"value": 1.'
    )
    assert re.search(r'lag 0.120 to 1.12 s', text_of(index_page(rows)))
    assert 'Every device shows' not in index_page(rows_for(2, 6))


def test_a_value_that_drifts_is_told_with_where_it_was_and_is(page):
    rows = rows_for(2, 10)
    worn = [row for row in rows if row['device'] == 'cell_2' and row['part'] == 'cylinder_b']
    for age, row in enumerate(worn):
        row[column_of('tau', 's')] = 0.010 + 0.001 * age
    assert 'Drifting' not in text_of(page)
    assert re.search(r'Unit cell_2 Cylinder B tau 0.0100 0.0190 s ', text_of(index_page(rows)))


def test_a_law_that_was_drawn_is_named(page):
    (row, *_) = rows_for(1, 1)
    row |= {'verdict': 'shape_found', 'effects': '', 'law': 'flow by displacement'}
    assert verdict_description(row) == 'Unknown characteristic: flow by displacement'


def test_a_bag_in_doubt_is_said_to_be(page):
    (row, *_) = rows_for(1, 1)
    assert verdict_description({**row, 'warnings': 'unit_suspect'}).endswith(' (check the data: unit_suspect)')


def test_a_changed_device_is_marked_in_words(page):
    text = text_of(page)
    changed = 'cell_1 Cylinder A 2023-11-15 22:13 Nothing missing Effect found: droop'
    assert 0 < text.index(changed) < text.index('Open a device to see')
    assert text.count('▲ changed 2023-11-15 22:13') == 1
    assert re.search(r'"marks":\[[0-9.]', page[page.index('id="device-1"') : page.index('id="device-2"')])
    assert 'class="mark"' not in page[page.index('id="device-2"') :]


def test_a_bag_that_failed_has_its_reason_escaped(page):
    assert 'is damaged: &lt;b&gt;badly&lt;/b&gt;' in page
    assert '<b>badly' not in page


def test_every_parameter_has_its_drift(page):
    device = page[page.index('id="device-2"') : page.index('id="device-3"')]
    names = re.findall(r'<div class="drift"><p><code[^>]*>([^<]+)', device)
    assert names[:6] == ['error', 'k_x', 'k_sv', 'k_v', 'tau', 'droop.slope']
    assert 'area' in names
    assert device.count('<svg') == len(names)


def test_devices_come_in_the_order_of_their_numbers(page):
    names = re.findall(r'<span class="name">([^<]+)', page)
    assert names == [f'cell_{number}' for number in range(1, 13)]


def test_it_stands_alone(page):
    assert not re.search(r'<script src="(?!plots.js")|<link rel="stylesheet|@import|url\((?!#)', page)
    targets = re.findall(r'(?:href|src)="([^"]*)', page)
    assert not [target for target in targets if re.match(r'(?!data:)[a-z]+:', target)]
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert {target[1:] for target in targets if target.startswith('#')} <= set(ids)


def test_its_size_stays_in_bounds(page):
    """Ten bytes more for a bag would be a hundred kilobytes for the 9,000 bags of a plant's month."""
    assert len(index_page(rows_for(4, 30))) < 4 * 30 * 1600 + 60_000


def test_the_same_rows_give_the_same_page(page):
    assert index_page(rows_for(12, 6)) == page


def test_a_plant_of_failures_alone():
    page = index_page([{'device': 'cell', 'bag': 'a.mcap', **failed_row('does not exist')}])
    assert 'device 1 bags 1 devices changed 0 bags failed 1' in text_of(page)


def test_bags_without_a_time_go_by_their_names():
    rows = [{**row, 'time': None} for row in rows_for(1, 4)]
    page = index_page(rows)
    assert 'shift_0.mcap' in text_of(page)
    assert 'UTC' not in text_of(page)


def test_links_lead_to_the_reports(small_results):
    targets = re.findall(r'href="([^"#:]+)"', (small_results / 'index.html').read_text(encoding='utf-8'))
    assert len(targets) == BAGS + 2
    assert all((small_results / unquote(target)).is_file() for target in targets)


# in a browser


@pytest.fixture(scope='module')
def file(page, tmp_path_factory):
    path = tmp_path_factory.mktemp('page') / 'index.html'
    path.write_text(page, encoding='utf-8')
    (path.with_name('plots.js')).write_text(shared_scripts(), encoding='utf-8')
    return path


@pytest.mark.parametrize(('width', 'height', 'dark'), [(1280, 800, False), (1280, 800, True), (390, 844, False)])
def test_a_browser_shows_it(browser, file, width, height, dark):
    browser.show(file, width, height, dark=dark)
    browser.value(OPEN_ALL)
    assert browser.heard('Runtime.consoleAPICalled', 'Runtime.exceptionThrown', 'Log.entryAdded') == []
    requested = [event['request']['url'] for event in browser.heard('Network.requestWillBeSent')]
    assert [url for url in requested if not url.startswith('data:')] == [
        file.as_uri(),
        file.with_name('plots.js').as_uri(),
    ]
    assert browser.value('document.documentElement.scrollWidth') <= width
    assert browser.value(OVERFLOWING) == 0
    assert browser.screenshot().startswith(b'\x89PNG')


def test_a_link_to_a_device_opens_it(browser, file):
    browser.show(file, 1280, 800)
    assert browser.value("document.querySelectorAll('.device[open]').length") == 0
    browser.value("document.querySelector('td a, th a').click()")
    assert browser.value("document.querySelector('.device[open] .name').textContent") == 'cell_1'
