# SPDX-License-Identifier: Apache-2.0
"""A short run of the fuzzers, the same every time, and whether they find what there is; `make fuzz` has longer ones."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from cfd_pneumatic.errors import InputError
from studies.trials.fuzz import kinds
from studies.trials.fuzzing import campaign
from studies.trials.fuzzing.campaign import Input, Kind, run

KINDS = kinds()


@pytest.mark.parametrize('name', KINDS)
def test_no_input_is_a_fault(tmp_path, monkeypatch, name):
    monkeypatch.setattr(campaign, '_PARENTS', 10)
    tally = run(KINDS[name], 30, 1, tmp_path)
    assert tally.faults == {}
    assert tally.inputs == 30
    assert 0 < tally.read < 30 or 'recorder' in name
    assert tally.early < 20


class Made(Kind):
    """Inputs that a function reads."""

    name = 'made'

    def __init__(self, read):
        self._read = read

    def valid(self, rng):
        return Input({'letters': b''})

    def changed(self, parent, rng):
        return parent.changed('letters', parent.files['letters'] + rng.choice((b'a', b'b', b'c')))

    def give(self, one):
        return self._read(one)

    def parses(self, one):
        return True


def stumble(_):
    raise ValueError('stumbled')


def refuse(one):
    raise InputError('is refused, valid or not')


def hang(_):
    while True:
        pass


def warn(_):
    np.float64(1e308) * 10.0
    warnings.warn('no number', RuntimeWarning, stacklevel=1)
    return ''


@pytest.mark.parametrize(
    ('read', 'said'),
    [
        (stumble, 'ValueError: stumbled'),
        (refuse, 'valid input is refused'),
        (hang, 'TooLong'),
        (warn, 'RuntimeWarning'),
    ],
)
def test_what_must_not_be_is_a_fault_and_its_input_is_kept(tmp_path, monkeypatch, read, said):
    monkeypatch.setattr(campaign, 'PATIENCE', 0.1)
    tally = run(Made(read), 10, 3, tmp_path, tmp_path / 'kept')
    ((count, first, what),) = tally.faults.values()
    assert said in what
    assert count == (tally.whole if read is refuse else 10) > 0
    assert (tmp_path / 'kept' / 'made' / str(first) / 'letters').is_file()


def test_what_gets_somewhere_new_is_changed_further(tmp_path):
    def read(one):
        letters = one.files['letters'].decode()
        return 'x' * next(length for length in range(9, -1, -1) if letters.startswith('abcabcabc'[:length]))

    seen = []
    tally = run(Made(lambda one: seen.append(read(one)) or seen[-1]), 3000, 1, tmp_path)
    assert max(map(len, seen)) == 9, 'no single change leads there'
    assert tally.parents == 10, 'one of each length'


def test_the_same_seed_makes_the_same_inputs(tmp_path):
    def inputs(seed):
        seen = []
        run(Made(lambda one: seen.append(one.files['letters']) or ''), 50, seed, tmp_path)
        return seen

    assert inputs(1) == inputs(1) != inputs(2)
