# SPDX-License-Identifier: Apache-2.0
"""Responses with a memory: linear filters, dead times, and the lag of a held command."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cfd_pneumatic.arrays import Array


class Response:
    """
    A linear response with unit gain, exact for an input that is linear between its values.

    Parameters
    ----------
    denominator
        Denominator of the transfer function [s^2, s, 1] or [s, 1].
    rest
        Input and output at rest before the first input.

    """

    def __init__(self, denominator: Sequence[float], rest: float) -> None:
        self._denominator = denominator
        self._rest = rest
        self._filter: tuple[Array, Array, Array] | None = None

    @classmethod
    def lag(cls, time_constant: float, rest: float) -> Response:
        """Return a first-order lag with a time constant [s]."""
        return cls((time_constant, 1.0), rest)

    @classmethod
    def resonance(cls, frequency: float, damping: float, rest: float) -> Response:
        """Return a resonance with a natural frequency [Hz] and a damping ratio [-]."""
        omega = 2.0 * np.pi * frequency
        return cls((1.0 / omega**2, 2.0 * damping / omega, 1.0), rest)

    def respond(self, inputs: Array, period: float) -> Array:
        """Return the outputs at the next inputs, one period apart; all calls need the same period [s]."""
        from scipy.signal import cont2discrete, lfilter, lfilter_zi  # slow to import

        if self._filter is None:
            numerator, denominator, _ = cont2discrete(([1.0], self._denominator), period, 'foh')
            self._filter = numerator[0], denominator, lfilter_zi(numerator[0], denominator) * self._rest
        numerator, denominator, state = self._filter
        outputs, state = lfilter(numerator, denominator, inputs, zi=state)
        self._filter = numerator, denominator, state
        return np.asarray(outputs)


class Delay:
    """
    A dead time.

    Parameters
    ----------
    dead_time
        Delay of the output [s].
    rest
        Input before the first input.

    """

    def __init__(self, dead_time: float, rest: float) -> None:
        self._dead_time = dead_time
        self._past = np.array([rest])

    def respond(self, inputs: Array, period: float) -> Array:
        """Return the outputs at the next inputs, one period apart [s]."""
        whole = int(self._dead_time / period)
        share = self._dead_time / period - whole
        missing = max(0, whole + 1 - len(self._past))
        known = np.concatenate([np.full(missing, self._past[0]), self._past, inputs])[-len(inputs) - whole - 1 :]
        self._past = known[len(inputs) :]
        newer, older = known[1 : len(inputs) + 1], known[: len(inputs)]
        return np.asarray(newer + share * (older - newer))


class HeldLag:
    """
    A first-order lag of an input that is constant in each period.

    Parameters
    ----------
    time_constant
        Time constant [s].
    rest
        Input and output at rest before the first input.

    """

    def __init__(self, time_constant: float, rest: float) -> None:
        self._time_constant = time_constant
        self._output = rest

    def respond(self, inputs: Array, period: float) -> Array:
        """Return the mean output in each of the next periods, one period long [s]."""
        decay = math.exp(-period / self._time_constant)
        mean_share = self._time_constant / period * -math.expm1(-period / self._time_constant)
        means = np.empty_like(inputs)
        for index, value in enumerate(inputs.tolist()):
            distance = self._output - value
            means[index] = value + mean_share * distance
            self._output = value + decay * distance
        return means
