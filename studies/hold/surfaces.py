# SPDX-License-Identifier: Apache-2.0
"""Random surfaces with a feed and a force, and errors of their scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.path import Surface, Task
from studies.hold.devices import regulators

DURATION = 20.0
"""Time in which a surface is passed at its feed [s]."""

SPACING = 5e-4
"""Distance between the points of a surface [m]."""

HEIGHT = (4e-4, 9e-4)
"""Range of the standard deviation of a surface [m]."""

HIGHEST_FREQUENCY = (3.0, 6.0)
"""Range of the highest frequency in the piston's motion at the feed [Hz]."""

HIGHEST = 2.8
"""Largest height of a surface before its burr, in standard deviations: within the stroke of the recording."""

FADE = 0.5
"""Time in which the surface fades in at its begin and fades out at its end [s]."""

SLOPE = 2.0
"""Largest rise of a slope over the whole path, up or down, in standard deviations of the waves."""

BURR, BURR_TIME = (2e-4, 5e-4), 0.04
"""Range of the height of a burr [m], and the time in which a tool passes half of the burr [s]."""

WITH_BURR = 0.4
"""Share of surfaces with a burr."""

TOLERANCE = 0.1
"""Largest accepted force error, as a share of the force."""

SCAN_ERROR, SCAN_LENGTH = 5e-5, 5e-3
"""Root mean square of the error of a scan [m], and the length over which the error changes [m]."""


class PathTask(NamedTuple):
    """
    A surface, and how the tool passes it.

    Attributes
    ----------
    surface
        The surface.
    feed
        Speed along the path [m/s].
    force
        Wanted contact force [N].
    burr
        Height of a burr [m]; 0 without a burr.

    """

    surface: Surface
    feed: float
    force: float
    burr: float

    @property
    def tolerance(self) -> float:
        """Largest accepted force error [N]."""
        return TOLERANCE * self.force

    def order(self, tolerance: float | None = None, *, hold: bool = False) -> Task:
        """Return the task of a preview."""
        return Task(self.force, self.feed, tolerance, regulators=regulators(), hold=hold)

    @property
    def facts(self) -> dict[str, float]:
        """Force, feed and height of the burr."""
        return {'force': self.force, 'feed': self.feed, 'burr': self.burr}


def draw_task(seed: int, number: int, duration: float = DURATION) -> PathTask:
    """Return a surface of a device by its number, with a feed and a force."""
    rng = np.random.default_rng([seed, number, 55])
    feed = float(rng.uniform(0.05, 0.15))
    along = np.linspace(0.0, feed * duration, round(feed * duration / SPACING) + 1)
    times = along / feed
    error = _waves(times, rng.uniform(*HIGHEST_FREQUENCY), rng) * _envelope(times)
    share = times / duration
    error += rng.uniform(-SLOPE, SLOPE) * share**2 * (3.0 - 2.0 * share)
    highest = HIGHEST * float(np.std(error))
    error = highest * np.tanh((error - np.mean(error)) / highest)
    error *= rng.uniform(*HEIGHT) / float(np.std(error))
    burr = float(rng.uniform(*BURR)) if rng.random() < WITH_BURR else 0.0
    place = duration * rng.uniform(0.2, 0.8)
    error -= burr * np.exp(-0.5 * ((times - place) / BURR_TIME) ** 2)  # a burr pushes the piston back
    return PathTask(Surface(along, error), feed, float(rng.uniform(15.0, 40.0)), burr)


def scanned(surface: Surface, size: float = SCAN_ERROR, seed: int = 0, length: float = SCAN_LENGTH) -> Surface:
    """Return a surface with a random error: its root mean square [m], and the length over which it changes [m]."""
    spacing = float(surface.along[1] - surface.along[0])
    noise = np.random.default_rng([seed, 56]).standard_normal(surface.along.size)
    error = gaussian_filter1d(noise, length / spacing)
    return Surface(surface.along, surface.error + size / rms(error) * error)


def _waves(times: Array, highest: float, rng: np.random.Generator) -> Array:
    """Return a random wave of unit variance with frequencies up to the highest [Hz]."""
    frequencies = np.arange(0.1, highest, 0.05)
    weights = rng.standard_normal((2, frequencies.size)) / np.hypot(1.0, frequencies / 2.0)
    angles = 2.0 * np.pi * np.multiply.outer(times, frequencies)
    wave = np.cos(angles) @ weights[0] + np.sin(angles) @ weights[1]
    return np.asarray(wave / np.std(wave))


def _envelope(times: Array) -> Array:
    """Return a factor that rises from 0 to 1 at the begin, and falls to 0 at the end."""
    share = np.clip(np.minimum(times, times[-1] - times) / FADE, 0.0, 1.0)
    return np.asarray(share**2 * (3.0 - 2.0 * share))
