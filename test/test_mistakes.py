"""Mistakes that users make are noticed, and clean recordings raise no warning."""

import random

import pytest

from studies.mistakes import DATA, MEASURED, MISTAKES, answer, is_told, warnings_of_clean

TRIED = 16
"""Of the mistakes; `make mistakes` makes all of them."""


def test_there_are_many_mistakes():
    assert len(MISTAKES) >= 40
    assert len({(one.on, one.what) for one in MISTAKES}) == len(MISTAKES)


@pytest.mark.parametrize('mistake', random.Random(16).sample(MISTAKES, TRIED), ids=lambda one: f'{one.on}: {one.what}')
def test_a_mistake_is_noticed(mistake):
    if mistake.on == 'measured' and not (DATA / f'{MEASURED}.csv').is_file():
        pytest.skip('the measured recordings are not to be had here')
    said = answer(mistake)
    assert is_told(mistake, said), said


@pytest.mark.parametrize('seed', range(8))  # others than those of the document
def test_clean_recordings_raise_no_warning(seed):
    assert warnings_of_clean(seed) == []
