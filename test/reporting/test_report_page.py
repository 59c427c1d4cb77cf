# SPDX-License-Identifier: Apache-2.0
"""`report.html`: what it says, and what a real browser makes of it."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from identified import closed, closed_on_two, judged, recording, with_force

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.reporting.page import report_page

IN_FIRST_SCREEN = """
[...document.querySelectorAll('.why')].map(one => {
    const box = one.getBoundingClientRect();
    return {text: one.textContent, seen: box.top >= 0 && box.bottom <= innerHeight && box.height > 0};
})
"""
WITHOUT_ALT = """
[...document.querySelectorAll('figure, svg, img')].filter(one => {
    const pictures = one.tagName === 'FIGURE' ? [...one.querySelectorAll('svg, img')] : [one];
    return !pictures.length || pictures.some(picture => (
        picture.getAttribute('role') !== 'img' || (picture.getAttribute('aria-label') || '').length < 40));
}).length
"""
OVERLAPPING_TEXT = """
[...document.querySelectorAll('table')].filter(one => one.scrollWidth > one.clientWidth + 1).length
"""


def page_of(identification):
    return report_page(identification)


@pytest.fixture(scope='module')
def page():
    return page_of(with_force(closed()))


def text_of(page):
    body = re.sub(r'<style>.*?</style>|<svg.*?</svg>', '', page, flags=re.DOTALL)
    return ' '.join(re.sub(r'<[^>]+>', ' ', body).split())


def test_the_verdicts_come_first(page):
    text = text_of(page)
    for outcome in with_force(closed()).closed:
        why = outcome.findings.why.replace('seal_friction', 'seal friction')
        assert 0 <= text.index(why[1:]) < text.index('Measured and simulated')
    assert 'cell_7_monday' in text


def test_it_stands_alone(page):
    assert not re.search(r'<script|<link rel="stylesheet|@import|url\((?!#)', page)
    assert all(target.startswith(('#', 'data:')) for target in re.findall(r'(?:href|src)="([^"]*)', page))
    assert len(page) < 1_500_000


def test_no_identifier_stands_twice(page):
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    used = set(re.findall(r'(?:xlink:href="|url\(|href=")#([^")]+)', page))
    assert used <= set(ids)


def test_the_colours_are_the_pages(page):
    assert not re.search(r'#00000[1-9]', page)
    assert {'var(--measured)', 'var(--before)', 'var(--after)'} <= set(re.findall(r'var\(--\w+\)', page))


def test_table_headings_have_their_scope(page):
    assert not re.search(r'<th(?! scope=)[ >]', page)


def test_numbers_stand_in_both_units(page):
    text = text_of(page)
    for word in ('Pa/m', 'lbf/in³', '[psi]', 'lbf', '95 %', 'droop.slope'):
        assert word in text


def test_rivals_are_named():
    changed = judged(closed(), 'effect_added', 'the model lacks one of them', {'droop': ('heat_transfer',)})
    assert 'cannot distinguish it from heat transfer' in text_of(page_of(changed))


@pytest.mark.parametrize(('verdict', 'words'), [
    ('effect_added', 'Effect found'),
    ('no_missing_effect', 'Nothing missing'),
    ('unexplained', 'Unexplained'),
    ('insufficient_data', 'Not enough data'),
])  # fmt: skip
def test_every_verdict_has_its_words(verdict, words):
    assert words in text_of(page_of(judged(closed(), verdict, 'some reason')))


def test_what_people_wrote_is_escaped():
    page = page_of(identify([replace(recording(), name='<b onload="x">&')], Options(close_loop=True)))
    assert '<b onload' not in page
    assert '&lt;b onload' in page


def test_the_same_result_gives_the_same_page():
    assert page_of(closed()) == page_of(closed())


def test_several_recordings_are_drawn_each():
    text = text_of(page_of(closed_on_two()))
    assert 'cell_7_monday, all' in text
    assert 'cell_7_tuesday, all' in text
    assert 'compare_1.mcap' in text


# in a browser


@pytest.fixture(scope='module')
def file(page, tmp_path_factory):
    path = tmp_path_factory.mktemp('page') / 'report.html'
    path.write_text(page, encoding='utf-8')
    return path


@pytest.mark.parametrize(('width', 'height', 'dark'), [(1280, 800, False), (1280, 800, True), (390, 844, False)])
def test_a_browser_shows_it(browser, file, width, height, dark):
    browser.show(file, width, height, dark=dark)
    assert browser.heard('Runtime.consoleAPICalled', 'Runtime.exceptionThrown', 'Log.entryAdded') == []
    requested = [event['request']['url'] for event in browser.heard('Network.requestWillBeSent')]
    assert [url for url in requested if not url.startswith('data:')] == [file.as_uri()]
    assert browser.value('document.documentElement.scrollWidth') <= width
    assert browser.value(WITHOUT_ALT) == 0
    assert browser.value(OVERLAPPING_TEXT) == 0
    verdicts = browser.value(IN_FIRST_SCREEN)
    assert verdicts[0]['text'].startswith('Missing effect: droop')
    assert verdicts[0]['seen']
    if width > 600:
        assert all(verdict['seen'] for verdict in verdicts)
    assert browser.screenshot().startswith(b'\x89PNG')


def test_it_prints(browser, file):
    browser.show(file, 1280, 800)
    assert browser.pdf().startswith(b'%PDF')
