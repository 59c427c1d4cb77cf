# SPDX-License-Identifier: Apache-2.0
"""Elements of a page: the numbers that the script gets are those of the chart, and texts are harmless."""

from __future__ import annotations

import base64
import json
import re
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.charts import Chart, Curve, Panel, chart_element, element, plot_scripts
from cfd_pneumatic.charts.element import column


def decoded(data: dict) -> np.ndarray:
    """Return the values of a column, read as the script reads them."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(data['text'])), np.uint8).reshape(data['bytes'], -1)
    counts, count = [], 0
    for digits in planes.T.tolist():
        count = (count + sum(digit * 256**place for place, digit in enumerate(digits))) % 256 ** data['bytes']
        counts.append(count)
    return data['low'] + data['step'] * np.array(counts)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50), st.sampled_from([4095, (1 << 24) - 1]))
def test_a_column_holds_its_values_to_half_a_step(values, steps):
    array = np.array(values)
    data = column(array, steps)
    assert data['size'] == array.size
    assert np.max(np.abs(decoded(data) - array)) <= 0.51 * data['step'] or np.ptp(array) == 0.0


def data_of(text: str) -> dict:
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)
    return json.loads(data)


def test_curves_of_one_clock_share_their_times():
    times = np.linspace(0.0, 60.0, 30_001)
    curves = [Curve(times, np.sin(times + shift), 'red', name=str(shift)) for shift in range(3)]
    chart = Chart([Panel('a', 100.0, curves)], (0.0, 60.0), 'time [s]', 'three')
    data = data_of(chart_element(chart))
    assert len(data['columns']) == 4
    assert np.allclose(decoded(data['columns'][0]), times, atol=1e-5)
    assert np.allclose(decoded(data['columns'][data['panels'][0]['curves'][2]['y']]), np.sin(times + 2), atol=1e-3)


def test_a_long_curve_keeps_its_extremes():
    times = np.arange(400_000) * 1e-3
    values = np.random.default_rng(3).standard_normal(times.size)
    values[123_456] = 50.0
    data = data_of(chart_element(Chart([Panel('a', 100.0, [Curve(times, values, 'red')])], (0.0, 400.0), '', 'long')))
    x, y = map(decoded, data['columns'])
    assert x.size <= element.MOST_POINTS
    assert x[np.argmax(y)] == pytest.approx(123.456, abs=1e-3)
    assert (y.max(), y.min()) == (pytest.approx(50.0), pytest.approx(values.min(), abs=0.02))


def test_a_text_cannot_end_the_script():
    name = '</script><script>alert(1)</script>'
    text = chart_element(Chart([Panel(name, 9.0, [])], (0.0, 1.0), name, name, name))
    assert text.count('<script') == text.count('</script>') == 1
    assert data_of(text)['axis'] == name


def test_without_plots_a_figure_has_no_data():
    chart = Chart([Panel('', 9.0, [Curve(np.arange(3.0), np.arange(3.0), 'red')])], (0.0, 2.0), '', 'static')
    assert '<script' not in chart_element(chart, has_plot=False)


def test_without_bokeh_there_are_no_scripts(monkeypatch):
    monkeypatch.setattr(element, '_bokeh_scripts', lambda: ())
    assert plot_scripts() == plot_scripts('../plots.js') == ''


def test_the_scripts_end_where_their_element_ends():
    pytest.importorskip('bokeh')
    text = plot_scripts()
    assert text.count('</script') == 1
    assert plot_scripts('../../plots.js') == '<script src="../../plots.js"></script>'
