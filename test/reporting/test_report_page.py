# SPDX-License-Identifier: Apache-2.0
"""`report.html`: what it says, and what a real browser makes of it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from identified import closed, closed_on_two, judged, recording, with_force
from scipy.ndimage import gaussian_filter1d

from cfd_pneumatic.charts import Chart, Curve, Panel, Window, chart_element
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.reporting.figures import record_chart
from cfd_pneumatic.reporting.page import report_page
from cfd_pneumatic.reporting.summary import summarise

IN_FIRST_SCREEN = """
[...document.querySelectorAll('.diagnosis')].map(one => {
    const box = one.getBoundingClientRect();
    return {text: one.textContent, seen: box.top >= 0 && box.bottom <= innerHeight && box.height > 0};
})
"""
WITHOUT_ALT = """
[...document.querySelectorAll('figure, svg, img')].filter(one => {
    const pictures = one.tagName === 'FIGURE' ? [...one.querySelectorAll('svg, img, [role=img]')] : [one];
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
    body = re.sub(r'<style>.*?</style>|<svg.*?</svg>|<script.*?</script>', '', page, flags=re.DOTALL)
    return ' '.join(re.sub(r'<[^>]+>', ' ', body).split())


def test_the_answers_come_first(page):
    text = text_of(page)
    found = with_force(closed())
    for outcome in found.closed:
        for answer in summarise(outcome, found):
            assert 0 <= text.index(answer.replace('\u00a0', ' ')) < text.index('Measured and simulated')
    assert 'cell_7_monday' in text


def test_it_stands_alone(page):
    assert not re.search(r'<script src|<link rel="stylesheet|@import', page)
    elements = re.sub(r'<script.*?</script>', '', page, flags=re.DOTALL)
    assert not re.search(r'url\((?!#)', elements)
    assert all(target.startswith(('#', 'data:')) for target in re.findall(r'(?:href|src)="([^"]*)', elements))


def test_a_minute_at_500_hz_fits_into_three_megabytes(page):
    """Of two cylinders and a force: a page of shorter recordings with the charts of a minute in place of its own."""
    rng = np.random.default_rng(5)
    times = np.linspace(0.0, 60.0, 30_001)
    smooth = [gaussian_filter1d(rng.standard_normal(times.size), 30.0) for _ in range(3)]
    noisy = [20.0 * curve + 0.1 * rng.standard_normal(times.size) for curve in smooth]
    panels = [
        Panel('displacement [mm]', 61, [Curve(times, smooth[0], 'red', name='displacement')]),
        Panel('pressure [kPa]', 166, [Curve(times, curve, 'red', name='p') for curve in (*smooth[1:], noisy[0])]),
        Panel('residual [Pa]', 133, [Curve(times, curve, 'red', name='r') for curve in noisy[1:]]),
    ]
    minute = chart_element(Chart(panels, (0.0, 60.0), 'time [s]', 'a minute', windows=[Window('here', 1.0, 2.0)]))
    shorter = sum(
        len(chart_element(record_chart(result, result.comparisons[0]))) for result in with_force(closed()).closed
    )
    assert len(page) - shorter + 3 * len(minute) < 3_000_000


def test_static_pages_have_no_scripts():
    page = report_page(closed(), scripts=None)
    assert '<script' not in page
    assert 'http' not in re.sub(r'xmlns="[^"]*"', '', page)


def test_pages_of_a_plant_share_their_scripts():
    pytest.importorskip('bokeh')
    page = report_page(closed(), scripts='../plots.js')
    assert '<script src="../plots.js"></script>' in page
    assert len(page) < 1_500_000


def test_no_identifier_stands_twice(page):
    ids = re.findall(r' id="([^"]+)"', re.sub(r'<script.*?</script>', '', page, flags=re.DOTALL))
    assert len(ids) == len(set(ids))
    elements = re.sub(r'<script.*?</script>', '', page, flags=re.DOTALL)
    used = set(re.findall(r'(?:xlink:href="|url\(|href=")#([^")]+)', elements))
    assert used <= set(ids)


def test_the_colours_are_the_pages(page):
    assert {'var(--measured)', 'var(--before)', 'var(--after)'} <= set(re.findall(r'var\(--\w+\)', page))


def test_table_headings_have_their_scope(page):
    assert not re.search(r'<th(?! scope=)[ >]', page)


def test_numbers_stand_in_both_units(page):
    text = text_of(page)
    for word in ('Pa/m', 'lbf/in³', '[psi]', 'lbf', '95 %', 'droop.slope'):
        assert word in text


def test_rivals_are_named():
    changed = judged(closed(), 'effect_added', 'the model lacks one of them', {'droop': ('heat_transfer',)})
    text = text_of(page_of(changed))
    assert 'Droop or heat transfer in cylinder A. This recording cannot distinguish them.' in text
    assert 'cannot distinguish it from heat transfer' in text


@pytest.mark.parametrize(('verdict', 'words'), [
    ('effect_added', 'Effect found'),
    ('no_missing_effect', 'Nothing missing'),
    ('unexplained', 'Unexplained'),
    ('insufficient_data', 'Not enough data'),
])  # fmt: skip
def test_every_verdict_has_its_words(verdict, words):
    assert words in text_of(page_of(judged(closed(), verdict, 'some reason')))


def test_what_people_wrote_is_escaped():
    name = '<b onload="x">&</script><script>alert(1)</script>'
    page = page_of(identify([replace(recording(), name=name)], Options(close_loop=True)))
    assert '<b onload' not in page
    assert '<script>alert' not in page
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
    assert verdicts[0]['text'].startswith('Droop in cylinder A: ')
    assert verdicts[0]['seen']
    if width > 600:
        assert all(verdict['seen'] for verdict in verdicts)
    assert browser.screenshot().startswith(b'\x89PNG')


def test_it_prints(browser, file):
    browser.show(file, 1280, 800)
    assert browser.pdf().startswith(b'%PDF')


# the plots


PLOTTED = "document.querySelectorAll('.live-chart').length"
FIRST_PLOT = "document.querySelector('.live-chart .live')"
READING = "document.querySelector('.live-chart output').textContent"


@pytest.fixture
def plots(browser, file):
    pytest.importorskip('bokeh')
    browser.show(file, 1280, 900)
    browser.value("document.querySelector('figure.chart').scrollIntoView()")
    browser.wait_for(f'{PLOTTED} > 0')
    browser.value(f'{FIRST_PLOT}.focus()')
    return browser


def seconds_of(reading):
    return float(re.match(r'time ([\d.]+) s: ', reading)[1])


def test_a_plot_takes_the_place_of_its_picture(plots):
    assert plots.value("getComputedStyle(document.querySelector('.live-chart .static')).display") == 'none'
    assert plots.value("getComputedStyle(document.querySelector('.window')).display") == 'none'
    assert plots.value("document.querySelector('.live-chart canvas, .live-chart .bk-Column') !== null")


def test_the_cursor_reads_every_curve(plots):
    plots.press('ArrowRight')
    plots.wait_for(f"{READING}.startsWith('time')")
    reading = plots.value(READING)
    for name in (
        'displacement',
        'measured',
        'simulated before',
        'simulated after',
        'residual before',
        'residual after',
    ):
        assert re.search(rf'{name} −?[\d.e]+ ', reading), reading
    comparison = closed().closed[0].comparisons[0]
    index = abs(comparison.times - seconds_of(reading)).argmin()
    measured = float(re.search(r', measured ([\d.]+) kPa', reading)[1])
    assert measured == pytest.approx(comparison.experiment.measured[index] / 1e3, rel=1e-3)


def test_keys_zoom_and_return(plots):
    plots.press('ArrowRight')
    whole = seconds_of(plots.value(READING))
    plots.press('ArrowRight')
    step = seconds_of(plots.value(READING)) - whole
    for _ in range(4):
        plots.press('+')
    before = seconds_of(plots.value(READING))
    plots.press('ArrowRight')
    assert seconds_of(plots.value(READING)) - before == pytest.approx(step / 16, rel=0.2)
    plots.press('Home')
    before = seconds_of(plots.value(READING))
    plots.press('ArrowRight')
    assert seconds_of(plots.value(READING)) - before == pytest.approx(step, rel=0.2)


def test_charts_of_a_recording_move_together(plots):
    readings = "[...document.querySelectorAll('.live-chart output')].map(one => one.textContent.split(':')[0])"
    plots.value("document.querySelector('section:nth-of-type(2) figure.chart').scrollIntoView()")
    plots.wait_for("document.querySelectorAll('.live-chart output').length > 1")
    plots.value(f'{FIRST_PLOT}.focus()')
    plots.press('ArrowLeft')
    times = set(plots.value(readings))
    assert len(times) == 1
    assert times.pop().startswith('time')


def test_without_scripts_the_pictures_stay(browser, file):
    browser.call('Emulation.setScriptExecutionDisabled', value=True)
    try:
        browser.show(file, 1280, 900)
        assert browser.value(PLOTTED) == 0
        assert browser.value("getComputedStyle(document.querySelector('.static')).display") != 'none'
    finally:
        browser.call('Emulation.setScriptExecutionDisabled', value=False)


@pytest.mark.parametrize('dark', [False, True])
def test_axe_finds_no_fault(browser, file, dark):
    axe = pytest.importorskip('axe_playwright_python.base', reason='axe-core is not here')
    browser.show(file, 1280, 900, dark=dark)
    browser.wait_for(f'{PLOTTED} > 0')
    browser.value(axe.AXE_FILE_PATH.read_text(encoding='utf-8'))
    found = browser.result('axe.run().then(found => found.violations.map(one => [one.id, one.nodes[0].html]))')
    assert found == []
