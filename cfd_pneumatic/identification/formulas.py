"""
Formulas for a curve: the simplest few of a small grammar that stay within its band wherever recordings have been.

What is even of a curve is the gains' and the offset's (`Shape.free`): there a formula is told but for a constant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = Callable[..., Array]

_MOST = 3  # formulas that are told
_STARTS = 60  # evaluations of each


@dataclass(frozen=True)
class Form:
    """
    One form of the grammar.

    Attributes
    ----------
    text
        How it is written, with its numbers' names.
    function
        Of the variable, from -1 to 1 over the range, and of numbers in it.
    starts
        Of the numbers behind the height, each a choice.
    lengths
        Which of the numbers are lengths of the variable, not places.
    constant
        Whether it is one only where a constant is another's.

    """

    text: str
    function: Function
    starts: tuple[tuple[float, ...], ...] = ()
    lengths: tuple[bool, ...] = ()
    constant: bool = False


_PLACES = (-0.6, -0.2, 0.2, 0.6)
_LENGTHS = (0.2, 0.6)
_BEYOND = 1.2  # a place is hardly beyond the range
_LONGEST = 4.0

GRAMMAR = (
    Form('{a} {z}', lambda u: u, constant=True),
    Form('{a} ({shift})', lambda u, b: u - b, (_PLACES,), (False,)),
    Form('{a} max({shift}, 0)', lambda u, b: np.maximum(u - b, 0.0), (_PLACES,), (False,)),
    Form('{a} max(-({shift}), 0)', lambda u, b: np.maximum(b - u, 0.0), (_PLACES,), (False,)),
    Form('{a} ({shift})^2', lambda u, b: (u - b) ** 2, (_PLACES,), (False,)),
    Form('{a} exp(-{z} / {c})', lambda u, c: np.exp(-u / c), (_LENGTHS,), (True,)),
    Form('{a} exp({z} / {c})', lambda u, c: np.exp(u / c), (_LENGTHS,), (True,)),
    Form('{a} tanh(({shift}) / {c})', lambda u, b, c: np.tanh((u - b) / c), (_PLACES, _LENGTHS), (False, True)),
    Form(
        '{a} exp(-(({shift}) / {c})^2)',
        lambda u, b, c: np.exp(-(((u - b) / c) ** 2)),
        ((-0.6, -0.3, 0.0, 0.3, 0.6), _LENGTHS),
        (False, True),
    ),
    Form(
        '{a} sin(2 pi ({shift}) / {c})',
        lambda u, b, c: np.sin(2.0 * np.pi * (u - b) / c),
        ((0.0, 0.3), (0.5, 0.8, 1.2, 1.8)),
        (False, True),
    ),
)
"""From the simplest on: a height `a`, the variable `z`, its `shift` from a place `b`, a length `c`."""


def formulas(at: Array, value: Array, low: Array, high: Array, variable: str, *, free: bool) -> tuple[str, ...]:
    """
    Return the simplest formulas that stay within a band, of as many numbers each; none where none does.

    Parameters
    ----------
    at, value, low, high
        A curve and its band where recordings have been, shape (n,), in SI units.
    variable
        How what it depends on is written.
    free
        Whether a constant is the gains' or the offset's.

    """
    if at.size < 5:
        return ()
    middle, half = 0.5 * (at[0] + at[-1]), 0.5 * (at[-1] - at[0])
    u, weights = (at - middle) / half, 2.0 / np.maximum(high - low, 1e-12 * max(np.ptp(value), 1e-300))
    found: list[tuple[int, float, str]] = []
    for form in GRAMMAR:
        if form.constant and not free:
            continue
        if found and 1 + len(form.starts) > found[0][0]:
            break
        numbers, height, constant = _fitted(form, u, value, weights, free)
        told = height * form.function(u, *numbers) + constant
        if np.all((told >= low) & (told <= high)):
            text = _written(form, numbers, height, middle, half, variable)
            found.append((1 + len(numbers), float(np.sum(((told - value) * weights) ** 2)), text))
    found.sort(key=lambda one: one[1])
    return tuple(text for _, _, text in found[:_MOST])


def _fitted(form: Form, u: Array, value: Array, weights: Array, free: bool) -> tuple[Sequence[float], float, float]:
    """Return numbers, height and constant of a form that come nearest."""
    from scipy.optimize import least_squares  # takes long to import, and few need it

    def linear(numbers: Sequence[float] | Array) -> tuple[Array, Array]:
        columns = np.column_stack([form.function(u, *numbers), *([np.ones_like(u)] if free else [])])
        known, *_ = np.linalg.lstsq(columns * weights[:, None], value * weights, rcond=None)
        return np.asarray(known), (columns @ known - value) * weights

    best, numbers = np.inf, tuple[float, ...]()
    for start in product(*form.starts):
        point = start
        if start:
            lower = [0.05 if one else -_BEYOND for one in form.lengths]
            upper = [_LONGEST if one else _BEYOND for one in form.lengths]
            point = tuple(
                least_squares(lambda at: linear(at)[1], start, bounds=(lower, upper), max_nfev=_STARTS).x.tolist()
            )
        misfit = float(np.sum(linear(point)[1] ** 2))
        if misfit < best:
            best, numbers = misfit, point
    known, _ = linear(numbers)
    return numbers, float(known[0]), float(known[1]) if free else 0.0


def _written(form: Form, numbers: Sequence[float], height: float, middle: float, half: float, variable: str) -> str:
    """Return a form with its numbers in SI units."""
    shift, length = variable, 0.0
    for number, is_length in zip(numbers, form.lengths):
        if is_length:
            length = number * half
        else:
            place = number * half + middle
            shift = f'{variable} {"-" if place > 0.0 else "+"} {abs(place):.4g}'
    if 'exp(-{z}' in form.text:
        height *= float(np.exp(middle / length))
    elif 'exp({z}' in form.text:
        height *= float(np.exp(-middle / length))
    elif '^2' in form.text and 'exp' not in form.text:
        height /= half**2
    elif not length:
        height /= half
    return form.text.format(a=f'{height:.4g}', z=variable, shift=shift, c=f'{length:.4g}')
