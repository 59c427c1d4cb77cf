"""Mistakes that users make are noticed, and clean recordings raise no warning."""

import random

import pytest

from studies.mistakes import DATA, MEASURED, MISTAKES, answer, is_told, warnings_of_clean

TRIED = 10
"""Of the mistakes; `make mistakes` makes all of them."""

TOO_LARGE = ('one pressure in bar', 'set-points absolute', 'bar read as MPa')
"""What no device holds ends in a report with a warning all the same."""

CHOSEN = [
    *random.Random(16).sample([one for one in MISTAKES if one.what not in TOO_LARGE], TRIED),
    *(one for one in MISTAKES if one.what in TOO_LARGE),
]


def test_there_are_many_mistakes():
    assert len(MISTAKES) >= 40
    assert len({(one.on, one.what) for one in MISTAKES}) == len(MISTAKES)


@pytest.mark.parametrize('mistake', CHOSEN, ids=lambda one: f'{one.on}: {one.what}')
def test_a_mistake_is_noticed(mistake):
    if mistake.on == 'measured' and not (DATA / f'{MEASURED}.csv').is_file():
        pytest.skip('the measured recordings are not to be had here')
    said = answer(mistake)
    assert is_told(mistake, said), said
    if mistake.what in TOO_LARGE:
        assert 'error' not in said.codes


@pytest.mark.parametrize('seed', [*range(8), 1213, 1465])  # others than the document's, but for two once warned of
def test_clean_recordings_raise_no_warning(seed):
    assert warnings_of_clean(seed) == []
