"""Mistakes that users make are noticed, and clean recordings raise no warning."""

import random

import numpy as np
import pytest

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import device_named, out_and_back, paper_step, record, surface_following
from studies.mistakes import DATA, MEASURED, MISTAKES, answer, is_told

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


@pytest.mark.parametrize('device', ['paper', 'real'])
@pytest.mark.parametrize('schedule', [paper_step, out_and_back, surface_following])
def test_clean_recordings_raise_no_warning(device, schedule):
    rng = np.random.default_rng(16)
    levels = {name: float(rng.uniform(3e4, 1.1e5)) for name in ('setpoint', 'setpoint_b')}
    length = {'duration': 20.0} if schedule is surface_following else {}
    played = record(schedule(**levels, **length), device_named(device, ''), seed=16)
    found = identify([recording_of(played)], Options(close_loop=True))
    assert [str(one) for one in found.notices if one.level == WARNING] == []
