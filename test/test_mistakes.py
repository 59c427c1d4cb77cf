# SPDX-License-Identifier: Apache-2.0
"""Mistakes that users make are noticed, and clean recordings raise no warning."""

import random

import pytest

from studies.trials.mistakes import LEFT_OUT, MEASURED, MISTAKES, answer, is_reported, warnings_of_clean

TOO_LARGE = ('everything in bar', 'set-points absolute')
"""What no device holds ends in a report with a warning all the same."""

TRIED = {
    *(('tutorial', what) for what in ('mm read as mil', 'set-points absolute', 'set-points swapped')),
    *(('tutorial', what) for what in ('pressures swapped', 'no set-points', 'the same twice', 'every fortieth row')),
    *(('tutorial', what) for what in ('inches read as mm, absolute psi as kPa', 'a sensor at its limit')),
    *(('rig', what) for what in ('everything in bar', 'half the area', 'force the other way')),
    *(('measured', what) for what in ('upside down', 'displacement the other way', 'bar read as Pa')),
}
"""
One of each code that tells of a mistake; a sample of the others comes on top, and `make mistakes` makes all.

What only the physical core sees of devices of full physics is for `identification/test_alternative_readings.py`.
"""

SAMPLED = 3
OTHERS = [one for one in MISTAKES if (one.table, one.description) not in TRIED and one.table != 'real']
CHOSEN = [one for one in MISTAKES if (one.table, one.description) in TRIED] + random.Random(16).sample(OTHERS, SAMPLED)


def test_there_are_many_mistakes():
    assert len(MISTAKES) >= 40
    assert len({(one.table, one.description) for one in MISTAKES}) == len(MISTAKES)
    assert len(CHOSEN) == len(TRIED) + SAMPLED
    codes = {code for one in MISTAKES for code in one.codes} - {
        'changed_during_recording',
        LEFT_OUT,
    }  # see test_held_out.py, test_wild_samples.py
    assert codes <= {code for one in CHOSEN for code in one.codes}


@pytest.mark.parametrize('mistake', CHOSEN, ids=lambda one: f'{one.table}: {one.description}')
def test_a_mistake_is_noticed(mistake):
    if mistake.table == 'measured' and not MEASURED.is_file():
        pytest.skip('the measured recordings are not to be had here')
    said = answer(mistake)
    assert is_reported(mistake, said), said
    if mistake.description in TOO_LARGE:
        assert 'error' not in said.codes


@pytest.mark.parametrize('seed', [1213, pytest.param(1465, marks=pytest.mark.long)])  # that were once warned of
def test_clean_recordings_raise_no_warning(seed):
    assert warnings_of_clean(seed) == []
