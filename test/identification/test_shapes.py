"""A law that no effect of the library is: where it enters, on what it depends, its curve, and when none is drawn."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from drawn import recording_of

from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.identification import ChannelResult, Options, identify
from cfd_pneumatic.model.effects.curve import CURVE
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.rig.panel import CLASSES, Draw, draw, oracle_residual


@cache
def drawn(law: str | None, make: str | None = None, seed: int = 0) -> Draw:
    return draw(law, 'surface_following', seed, make=make)


@cache
def found(law: str | None, make: str | None = None, seed: int = 0) -> ChannelResult:
    recording = recording_of(drawn(law, make, seed))
    return identify([recording], Options(close_loop=True)).cylinders['cylinder_a']


def floor(one: Draw, result: ChannelResult) -> float:
    """Return what the true device leaves on the part that the answer is judged on [Pa]."""
    judged = result.judged(result.comparisons[0])
    return float(np.sqrt(np.mean(oracle_residual(one)[judged] ** 2)))


@pytest.mark.parametrize(('law', 'make'), [('bulge', 'orifices'), ('rushing_air', None)])
def test_a_law_that_is_in_no_library_is_drawn_where_it_enters(law: str, make: str | None) -> None:
    result = found(law, make)
    findings = result.findings
    assert (findings.verdict, findings.effects) == ('shape_found', ())
    assert findings.unknown is not None
    shape = findings.unknown
    places = [(shape.enters, shape.against), *shape.others]
    assert CLASSES[law] & {(enters.replace('leak', 'chamber'), against) for enters, against in places}
    assert result.rmse(1) < 1.1 * floor(drawn(law, make), result)
    assert result.rmse(1) < 0.9 * result.rmse(0)
    assert 0.1 < shape.explains < 1.0
    assert np.all((shape.low <= shape.value) & (shape.value <= shape.high))


def test_the_curve_is_the_law_but_for_what_the_gains_have() -> None:
    shape, changes = found('bulge', 'orifices').findings.unknown, drawn('bulge', 'orifices').truth.changes
    assert shape is not None
    middle, length = changes['odd_a.bulge_position'], changes['odd_a.bulge_length']
    true = 1.0 + changes['odd_a.bulge'] * np.exp(-(((shape.at - middle) / length) ** 2))
    seen = shape.visited
    true /= float(np.median(true[seen] / (1.0 + shape.value[seen])))  # K_x is free
    error = shape.value[seen] - (true[seen] - 1.0)
    assert np.sqrt(np.mean(error**2)) < 0.08 * np.ptp(true)
    assert np.mean(shape.high[seen] - shape.low[seen]) < 0.3 * np.ptp(true)


def test_it_stands_in_the_report_and_runs_in_the_device() -> None:
    one = drawn('rushing_air')
    identification = identify([recording_of(one)], Options(close_loop=True))
    block = report_data(identification)['cylinders']['cylinder_a']
    law = block['unknown']
    assert (law['enters'], law['against'], law['unit'], law['unit_against']) == ('set_point', 'speed', 'Pa', 'm/s')
    sizes = {len(law['curve'][name]) for name in ('at', 'value', 'low', 'high')}
    assert len(sizes) == 1
    assert sizes.pop() > 20
    device = identified_device(identification).model
    assert device.a is not None
    assert device.a.effects[CURVE] == identification.cylinders['cylinder_a'].found.model.effects[CURVE]


def test_recordings_of_a_healthy_device_draw_nothing() -> None:
    assert found(None).findings.unknown is None
    assert found(None, 'orifices').findings.unknown is None


def test_a_clock_that_runs_fast_is_no_law() -> None:
    identification = identify([recording_of(draw('fast_clock', 'out_and_back', 1))], Options(close_loop=True))
    assert identification.cylinders['cylinder_a'].findings.unknown is None
