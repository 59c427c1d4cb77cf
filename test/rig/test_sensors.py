# SPDX-License-Identifier: Apache-2.0
"""What the sensors add to the truth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import Sensors
from cfd_pneumatic.units import INCH, PSI

MANY = 100_000


def test_noise_is_white_and_as_large_as_told() -> None:
    sensors = Sensors(bits=0)
    rng = np.random.default_rng(1)
    noises = {
        7.5e-3 * PSI: sensors.measure_pressure(np.full(MANY, 1.5e5), rng) - 1.5e5,
        20e-6 * INCH: sensors.measure_displacement(np.full(MANY, 1e-3), rng) - 1e-3,
        0.1: sensors.measure_force(np.full(MANY, 10.0), rng) - 10.0,
    }
    for deviation, noise in noises.items():
        assert np.std(noise) == pytest.approx(deviation, rel=0.02)
        assert np.mean(noise) == pytest.approx(0.0, abs=0.02 * deviation)
        assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.0, abs=0.02)


@given(st.floats(-1e-3, 1e-3))
def test_without_noise_a_reading_is_the_nearest_step(value: float) -> None:
    sensors = Sensors(displacement_noise=0.0)
    step = sensors.step(sensors.displacement_range)
    reading = sensors.measure_displacement(value, np.random.default_rng(0))
    assert abs(reading - value) <= step / 2 * (1 + 1e-9)
    count = (reading - sensors.displacement_range[0]) / step
    assert count == pytest.approx(round(float(count)), abs=1e-6)
    assert step == pytest.approx(12.7e-3 / 4095)


def test_readings_end_at_full_scale() -> None:
    sensors = Sensors()
    readings = sensors.measure_pressure([0.0, 1e6], np.random.default_rng(0))
    assert readings == pytest.approx([AMBIENT_PRESSURE, AMBIENT_PRESSURE + 30 * PSI])


def test_twelve_bits_have_4096_readings() -> None:
    sensors = Sensors(pressure_noise=0.0)
    sweep = np.linspace(*sensors.pressure_range, MANY)
    assert len(np.unique(sensors.measure_pressure(sweep, np.random.default_rng(0)))) == 4096


@given(st.floats(0.0, 1e-2), st.integers(0, 2**32))
def test_stamps_never_go_back(jitter: float, seed: int) -> None:
    times = 2e-3 * np.arange(200)
    stamps = Sensors(stamp_jitter=jitter).stamp(times, 2e-3, np.random.default_rng(seed))
    assert np.all(np.diff(stamps) > 0.0)


def test_stamps_stray_as_told() -> None:
    times = 2e-3 * np.arange(MANY)
    strayed = Sensors().stamp(times, 2e-3, np.random.default_rng(1)) - times
    assert np.std(strayed) == pytest.approx(5e-5, rel=0.02)


def test_one_by_one_is_the_same_as_at_once() -> None:
    sensors = Sensors()
    truth = np.linspace(1.2e5, 1.4e5, 50)
    at_once = sensors.measure_pressure(truth, np.random.default_rng(7))
    rng = np.random.default_rng(7)
    assert np.array_equal(at_once, [sensors.measure_pressure(value, rng) for value in truth])


@pytest.mark.parametrize(
    'bad', [{'pressure_noise': -1.0}, {'stamp_jitter': float('nan')}, {'bits': -1}, {'force_range': (1.0, 1.0)}]
)
def test_sensors_that_cannot_be_built_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(bad))):
        Sensors(**bad)
