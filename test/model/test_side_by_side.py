# SPDX-License-Identifier: Apache-2.0
"""Cylinders side by side in the lanes of the kernel: none knows of the others."""

from itertools import pairwise

import numpy as np
import pytest
from effect_cases import CASES, DATA, GAINS
from reference import AMBIENT, PSI

from cfd_pneumatic.model import ExtendedCylinder
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS
from cfd_pneumatic.model.extended import SideBySide, extremes
from cfd_pneumatic.model.lanes import COUNT
from cfd_pneumatic.model.places import PARAMETERS, PLACES, all_parameters

TIMES = np.arange(250) * 0.002
STROKE = np.interp(TIMES, [0.05, 0.06, 0.3, 0.31], [0.0, 1.5e-3, 1.5e-3, 0.0])
SETPOINT = np.where(TIMES < 0.2, AMBIENT + 5.0 * PSI, AMBIENT + 5.5 * PSI)
ALL = {name: effect.starts(DATA)[0] for name, effect in PRESSURE_EFFECTS.items()}


def strewn(effects, count, rng):
    """Return parameters of cylinders about those of one, choices apart, shape (count, parameters)."""
    rows = all_parameters(GAINS, effects) * rng.uniform(0.9, 1.1, (count, PARAMETERS))
    for name, own in effects.items():
        for index, parameter in enumerate(PRESSURE_EFFECTS[name].parameters, PLACES[name].parameters.start):
            if parameter.choice:
                rows[:, index] = own[index - PLACES[name].parameters.start]
            rows[:, index] = np.clip(rows[:, index], parameter.lower, parameter.upper)
    return rows


@pytest.mark.parametrize('count', [COUNT, COUNT + 3])
@pytest.mark.parametrize('effects', [*({case.values[0]: case.values[1]} for case in CASES), ALL], ids=str)
def test_side_by_side_each_is_as_it_is_alone(effects, count):
    rng = np.random.default_rng(11)
    rows, offsets, starts = strewn(effects, count, rng), rng.normal(0.0, 300.0, count), rng.normal(0.0, 300.0, count)
    cylinder = ExtendedCylinder(GAINS, effects, AMBIENT)
    stiffness = cylinder.stiffness(*extremes(TIMES, STROKE, SETPOINT))
    together = SideBySide(cylinder, rows, offsets, starts, 0.0, stiffness).simulate_piece(TIMES, STROKE, SETPOINT)
    assert together.shape == (TIMES.size, count)
    assert np.min(np.std(together, axis=1)) > 1.0, 'they differ'
    for one in range(count):
        alone = SideBySide(cylinder, rows[[one]], offsets[[one]], starts[[one]], 0.0, stiffness)
        np.testing.assert_allclose(
            together[:, one], alone.simulate_piece(TIMES, STROKE, SETPOINT)[:, 0], rtol=0.0, atol=1e-6
        )


@pytest.mark.parametrize('effects', [*({case.values[0]: case.values[1]} for case in CASES), ALL], ids=str)
def test_a_recording_in_pieces_is_followed_as_a_whole(effects):
    rng = np.random.default_rng(12)
    rows, offsets, starts = strewn(effects, 2, rng), rng.normal(0.0, 300.0, 2), rng.normal(0.0, 300.0, 2)
    cylinder = ExtendedCylinder(GAINS, effects, AMBIENT)
    stiffness = cylinder.stiffness(*extremes(TIMES, STROKE, SETPOINT))
    whole = SideBySide(cylinder, rows, offsets, starts, 0.0, stiffness).simulate_piece(TIMES, STROKE, SETPOINT)
    in_pieces = SideBySide(cylinder, rows, offsets, starts, 0.0, stiffness)
    for begin, end in pairwise([0, 1, 40, 41, TIMES.size - 1]):
        piece = slice(begin, end + 1)
        np.testing.assert_array_equal(
            in_pieces.simulate_piece(TIMES[piece], STROKE[piece], SETPOINT[piece]), whole[piece]
        )


@pytest.mark.parametrize('effect', ['leakage', 'volume_variation', 'valve_dead_band', 'line_restriction'])
def test_an_acceleration_bends_the_way_between_samples(effect):
    cylinder = ExtendedCylinder(GAINS, {effect: ALL[effect]}, AMBIENT)
    row = all_parameters(GAINS, cylinder.effects)[None]
    times, per_sample, turns = np.arange(10_001) * 5e-5, 40, 50.0  # [s], [rad/s]
    displacement, setpoint = 1e-3 * np.sin(turns * times), np.full(times.size, SETPOINT[0])
    stiffness = cylinder.stiffness(*extremes(times, displacement, setpoint))

    def read(every, acceleration=None):
        alone = SideBySide(cylinder, row, np.zeros(1), np.zeros(1), 0.0, stiffness)
        return alone.simulate_piece(times[::every], displacement[::every], setpoint[::every], acceleration)[:, 0]

    truth = read(1)[::per_sample]
    halfway = -(turns**2) * displacement[per_sample // 2 :: per_sample]
    bent = np.std(read(per_sample, np.append(0.0, halfway)) - truth)
    assert bent < 0.4 * np.std(read(per_sample) - truth)
