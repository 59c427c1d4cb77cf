# SPDX-License-Identifier: Apache-2.0
"""Two cylinders, contact force, and following samples by their stamps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.model import TABLE_1, Arrival, Cylinder, DeviceModel, ForceGeometry, LiveDevice, Movement

AMBIENT = 101_325.0
GEOMETRY = ForceGeometry(area=1.1e-3, geometric_factor=1.5, ambient_pressure=AMBIENT)


def device(present='ab'):
    cylinder = Cylinder(TABLE_1, AMBIENT)
    return DeviceModel(*(cylinder if side in present else None for side in 'ab'), GEOMETRY)


@given(st.floats(-100.0, 100.0), st.floats(1e4, 1e5), st.sampled_from(['ab', 'a', 'b']))
def test_set_points_give_the_wanted_force_at_rest(force, bias, present):
    one = device(present)
    a, b = one.setpoints(force, bias)
    assert one.contact_force(one.at_rest(a + AMBIENT, b + AMBIENT)) == pytest.approx(force, abs=1e-6)
    if present == 'ab':
        assert 0.5 * (a + b) == pytest.approx(bias)


def test_positive_displacement_grows_a_and_shrinks_b():
    movement = Movement(time=0.01, duration=0.01, begin=0.0, end=5e-4)
    state = device().step(device().at_rest(1.4e5, 1.4e5), movement, 1.4e5, 1.4e5)
    assert state.a.p < 1.4e5 < state.b.p
    assert device().contact_force(state) < 0.0


@pytest.mark.parametrize(('present', 'sign'), [('a', 1.0), ('b', -1.0)])
def test_a_single_cylinder_works_against_ambient(present, sign):
    one = device(present)
    rest = one.at_rest(AMBIENT + 1e4, AMBIENT + 1e4)
    assert one.contact_force(rest) == pytest.approx(sign * 1e4 * 1.1e-3 * 1.5)
    state = one.step(rest, Movement(time=0.01, duration=0.01, begin=0.0, end=5e-4), AMBIENT + 1e4, AMBIENT + 1e4)
    assert [name[-1] for name, own in zip(CYLINDERS, state) if own is not None] == [present]
    assert one.contact_force(state) < one.contact_force(rest)


def test_a_device_has_a_cylinder():
    with pytest.raises(ValueError, match='at least one cylinder'):
        device('')


def follow(samples, live=None):
    live = live or LiveDevice(device(), max_gap=0.1)
    for stamp, position in samples:
        live.sample(stamp, position, (1.5e5, 1.4e5))
    return live


SAMPLES = [(1_000_000_000 + 2_000_000 * i, 1e-4 * np.sin(0.3 * i)) for i in range(40)]


def test_the_same_samples_give_the_same_state():
    assert follow(SAMPLES).committed == follow(SAMPLES).committed


def test_previews_commit_nothing():
    live = follow(SAMPLES[:20])
    for elapsed in (0.01, 0.02, 0.5):
        live.preview(elapsed, (1.5e5, 1.4e5))
    assert follow(SAMPLES[20:], live).committed == follow(SAMPLES).committed


def test_a_preview_equals_the_sample_that_holds_the_piston():
    live = follow(SAMPLES)
    preview = live.preview(0.01, (1.5e5, 1.4e5))
    last = live.committed
    live.sample(last.stamp + 10_000_000, last.position, (1.5e5, 1.4e5))
    assert live.committed.state == preview


def test_what_becomes_of_a_sample():
    live = LiveDevice(device(), max_gap=0.1)
    assert live.preview(0.1, (1.5e5, 1.4e5)) is None
    assert live.sample(10**9, 0.0, (1.5e5, 1.4e5)) is Arrival.FIRST
    assert live.sample(10**9 + 10**6, 1e-4, (1.5e5, 1.4e5)) is Arrival.ADVANCED
    moved = live.committed
    assert live.sample(10**9 + 10**6, 9.0, (1.5e5, 1.4e5)) is Arrival.REPEATED
    assert live.committed == moved
    assert live.sample(10**9, 1e-4, (1.5e5, 1.4e5)) is Arrival.WENT_BACK
    assert live.committed.state == device().at_rest(1.5e5, 1.4e5)
    assert live.sample(2 * 10**9, 2e-4, (1.6e5, 1.4e5)) is Arrival.AFTER_GAP
    assert live.committed.state == device().at_rest(1.6e5, 1.4e5)
    live.reset()
    assert live.sample(0, 0.0, (1.5e5, 1.4e5)) is Arrival.FIRST
