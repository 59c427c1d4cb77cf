# SPDX-License-Identifier: Apache-2.0
"""What is usual, learned from residuals of which everything is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.signal import lfilter

from cfd_pneumatic.monitoring.baseline import FEWEST_BLOCKS, Baseline, learn_baseline
from cfd_pneumatic.monitoring.watched_signal import ResidualBlock, WatchedSignal

NOISE, TIMING, SAMPLES, BLOCKS = 50.0, 2e-4, 100, 400


def residuals(seed: int, memory: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals with noise and, at a rate that comes and goes, jitter; each of shape (blocks, samples)."""
    rng = np.random.default_rng(seed)
    count = BLOCKS * SAMPLES
    rates = 1e6 * np.sin(np.arange(count) / 300.0) ** 9
    noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.standard_normal(count))
    together = NOISE * noise + TIMING * rates * rng.standard_normal(count)
    return together.reshape(BLOCKS, SAMPLES), rates.reshape(BLOCKS, SAMPLES)


def learned(together: np.ndarray, rates: np.ndarray, tolerance: float | None = None) -> Baseline:
    return learn_baseline(list(together), list(rates), tolerance)


def test_noise_and_timing_are_told_apart() -> None:
    noise_model = learned(*residuals(1)).noise_model
    assert noise_model.noise == pytest.approx(NOISE, rel=0.05)
    assert noise_model.timing == pytest.approx(TIMING, rel=0.1)
    assert noise_model.coefficients.size == 0


def test_the_memory_of_noise_is_taken_out() -> None:
    together, _ = residuals(2, memory=0.8)
    baseline = learned(together, np.zeros_like(together))
    noise_model = baseline.noise_model
    innovations = noise_model.innovations(together.ravel(), np.empty(0))
    assert np.corrcoef(innovations[1:], innovations[:-1])[0, 1] == pytest.approx(0.0, abs=0.02)
    assert baseline.mean.std == pytest.approx(NOISE * 3.0 / np.sqrt(SAMPLES), rel=0.2), 'long-run: root of 1.8 over 0.2'


def test_pieces_have_the_innovations_of_the_whole() -> None:
    together, _ = residuals(3, memory=0.8)
    noise_model = learned(together, np.zeros_like(together)).noise_model
    whole = noise_model.innovations(together.ravel(), np.empty(0))
    before, pieces = np.empty(0), []
    for piece in np.split(together.ravel(), [3, 4, 150, 151, 2000]):
        pieces.append(noise_model.innovations(piece, before))
        before = np.concatenate([before, piece])[-20:]
    assert np.concatenate(pieces) == pytest.approx(whole)


def test_means_and_energies_are_those_of_the_blocks() -> None:
    together, rates = residuals(4)
    baseline = learned(together, rates)
    means, energies = baseline.noise_model.features(together[:, :] + 1000.0)
    assert np.mean(means) == pytest.approx(1000.0, rel=0.02)
    assert baseline.energy.mean == pytest.approx(1.0, abs=0.02)
    assert baseline.noise_model.root_mean_square(baseline.energy.mean) == pytest.approx(NOISE, rel=0.1)
    assert np.all(energies > 2.0)


def test_noise_alone_makes_no_tolerance_and_wandering_makes_its_own() -> None:
    together, rates = residuals(5)
    assert learned(together, rates).mean.tolerance < 0.1 * NOISE / np.sqrt(SAMPLES)
    wandering = together + 80.0 * np.sign(np.sin(np.arange(BLOCKS) / 40.0))[:, None]
    assert learned(wandering, rates).mean.tolerance == pytest.approx(80.0, rel=0.2)
    assert learned(wandering, rates, tolerance=5.0).mean.tolerance == 5.0


LARGEST = 1e12
VALUES = st.floats(-LARGEST, LARGEST) | st.integers(-10, 10).map(float)


@given(
    pattern=st.lists(VALUES, min_size=1, max_size=9),
    spikes=st.dictionaries(st.integers(0, 10 * FEWEST_BLOCKS - 1), VALUES, max_size=3),
    rates=st.lists(st.floats(-1e15, 1e15), min_size=1, max_size=9),
    then=st.lists(VALUES, min_size=10, max_size=10),
)
@example(pattern=[0.0], spikes={}, rates=[0.0], then=[LARGEST] * 10)
@example(pattern=[137.25], spikes={}, rates=[0.0], then=[-LARGEST] * 10)
@example(pattern=[0.0, 1e-300], spikes={3: LARGEST}, rates=[0.0, 1e15], then=[0.0] * 10)
def test_whatever_is_learned_from_what_comes_then_is_charted(
    pattern: list[float], spikes: dict[int, float], rates: list[float], then: list[float]
) -> None:
    count = 10 * FEWEST_BLOCKS
    residuals = np.resize(pattern, count)
    residuals[list(spikes)] = list(spikes.values())
    channel = WatchedSignal('cylinder_a', FEWEST_BLOCKS, 10, 1e4)
    with np.errstate(divide='raise', invalid='raise', over='raise'):
        for number, blocks in enumerate(
            zip(np.split(residuals, FEWEST_BLOCKS), np.split(np.resize(rates, count), FEWEST_BLOCKS))
        ):
            channel.add_block(ResidualBlock(10 * number, *blocks))
        for number in range(FEWEST_BLOCKS, FEWEST_BLOCKS + 30):
            channel.add_block(ResidualBlock(10 * number, np.array(then), np.zeros(10)))
        departure = channel.describe(10 * FEWEST_BLOCKS, is_mean_shift=True)
    assert np.all(np.isfinite([channel.usual_rms, channel.alarm_proximity, channel.relative_spread, departure.shift]))
