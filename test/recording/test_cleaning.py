# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import memory_maps
from cfd_pneumatic.recording.cleaning import clean, quantiles_of_intervals

MILLISECOND = 1_000_000


def cleaned(milliseconds, values=None, **options):
    times = np.array(milliseconds, np.int64) * MILLISECOND
    values = np.arange(len(times), dtype=float) if values is None else np.array(values, float)
    return clean(times, values, 'x', **options)


samples = st.lists(
    st.tuples(st.integers(0, 900), st.floats(allow_nan=True, allow_infinity=True)), min_size=1, max_size=40
).filter(lambda pairs: any(np.isfinite(value) for _, value in pairs))


@given(samples, st.booleans())
def test_samples_come_out_in_order_once_and_finite(pairs, held):
    result = cleaned([time for time, _ in pairs], [value for _, value in pairs], held=held)
    assert (np.diff(result.times) > 0).all()
    assert np.isfinite(result.values).all()
    given_pairs = {(time * MILLISECOND, value) for time, value in pairs if np.isfinite(value)}
    assert set(zip(result.times.tolist(), result.values.tolist())) <= given_pairs
    assert set(result.times.tolist()) == {time for time, _ in given_pairs}


@given(samples, st.booleans())
def test_cleaning_twice_changes_nothing(pairs, held):
    once = cleaned([time for time, _ in pairs], [value for _, value in pairs], held=held)
    twice = clean(once.times, once.values, 'x', held=held)
    np.testing.assert_array_equal(twice.times, once.times)
    np.testing.assert_array_equal(twice.values, once.values)
    assert not any('order' in note or 'finite' in note or 'another' in note for note in twice.notes)


def test_a_regular_signal_needs_no_note():
    assert cleaned(range(0, 200, 10)).notes == ()


def test_disorder_is_sorted_and_counted():
    result = cleaned([0, 10, 30, 20, 40])
    assert result.values.tolist() == [0, 1, 3, 2, 4]
    assert result.notes == ('x: sorted 1 sample out of order',)


def test_the_first_of_several_samples_at_a_time_is_kept():
    result = cleaned([0, 10, 10, 10, 20, 30])
    assert result.values.tolist() == [0, 1, 4, 5]
    assert result.notes == ('x: 2 samples at the time of another, kept the first',)


def test_the_last_of_several_setpoints_at_a_time_counts():
    result = cleaned([0, 10, 10, 500], held=True)
    assert result.values.tolist() == [0, 2, 3]
    assert result.notes == ('x: 1 sample at the time of another, kept the last',)


def test_gaps_are_counted():
    assert cleaned([*range(0, 500, 10), *range(900, 1500, 10), *range(1800, 2300, 10)]).notes == (
        'x: 2 gaps, the longest 0.41 s',
    )


def test_jitter_is_told():
    assert cleaned(np.cumsum([10, 10, 14, 10, 18, 10, 14] * 10)).notes == ('x: intervals of 10 to 18 ms about 10 ms',)


def test_time_that_goes_back_a_little_is_sorted_and_far_is_refused():
    assert cleaned([0, 1000, 1, 1001]).notes[0] == 'x: sorted 1 sample out of order'
    with pytest.raises(InputError, match=r'^x: time goes back by 1\.001 s at sample 3: the clock was set back'):
        cleaned([0, 1001, 0, 1002])


@given(samples, st.booleans(), st.integers(1, 8))
def test_part_by_part_is_the_same_as_at_once(pairs, held, part):
    """`parts` says how many samples are looked at together; here few, so that what is late comes in another part."""
    times, values = [time for time, _ in pairs], [value for _, value in pairs]
    whole = cleaned(times, values, held=held)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory_maps, 'PART', part)
        pieces = cleaned(times, values, held=held)
    assert pieces.times.tolist() == whole.times.tolist()
    assert pieces.values.tolist() == whole.values.tolist()
    assert pieces.notes == whole.notes


@given(st.lists(st.integers(1, 10**8), min_size=2, max_size=200), st.integers(1, 50))
def test_quantiles_of_intervals_are_those_of_numpy(intervals, part):
    times = np.cumsum([0, *intervals])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory_maps, 'PART', part)
        found = quantiles_of_intervals(times, (0.05, 0.5, 0.95))
    np.testing.assert_allclose(found, np.percentile(intervals, [5, 50, 95]), rtol=0, atol=1e-4 * np.mean(intervals) + 1)
