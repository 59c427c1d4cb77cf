# SPDX-License-Identifier: Apache-2.0
"""
Formulas for a curve: the simplest few of a small grammar that stay within its band wherever recordings have been.

What is even of a curve is the gains' and the offset's (`Shape.free`): there a formula is told but for a constant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.thresholds import (
    FEWEST_CURVE_POINTS,
    LEAST_BAND,
    LEAST_CURVE_RANGE,
    LENGTH_BOUNDS,
    MOST_FORMULA_EVALUATIONS,
    MOST_FORMULAS,
    PLACE_BOUNDS,
    REFINED_STARTS,
)

Function = Callable[..., Array]


@dataclass(frozen=True)
class Formula:
    """
    A formula for a curve.

    Attributes
    ----------
    text
        As it is written, with its numbers in SI units.
    code
        As an effect's function has it, of the variable `z` and of its numbers' names.
    numbers
        A height `a`, and as far as there are these a place `b` and a length `c` of the variable, in SI units.
    told
        The curve as it has it at values of the variable, with the constant that came nearest.
    power
        Of the variable, by which the height is told.

    """

    text: str
    code: str
    numbers: Mapping[str, float]
    told: Function = field(repr=False, compare=False)
    power: int = 0


@dataclass(frozen=True)
class Form:
    """
    One form of the grammar.

    Attributes
    ----------
    text, code
        As in `Formula`, with names for its numbers.
    function
        Of the variable, from -1 to 1 over the range, and of its place and its length there.
    starts
        Of these, each a choice.
    has
        Which there are: `b`, `c`.
    power
        Of the variable, by which the height is told.
    grows
        By how many lengths its logarithm grows with each length of the variable: of an exponential.
    constant
        Whether it is one only where a constant is another's.

    """

    text: str
    code: str
    function: Function
    starts: tuple[tuple[float, ...], ...] = ()
    has: str = ''
    power: int = 0
    grows: float = 0.0
    constant: bool = False


_PLACES = (-0.6, -0.2, 0.2, 0.6)
_LENGTHS = (0.2, 0.6)
_LIMITS = {'b': PLACE_BOUNDS, 'c': LENGTH_BOUNDS}

_HUMPS = (-0.6, -0.3, 0.0, 0.3, 0.6)
_WAVES = (0.5, 0.8, 1.2, 1.8)

GRAMMAR = (
    Form('{a} {z}', 'a * z', lambda u: u, power=1, constant=True),
    Form('{a} ({shift})', 'a * (z - b)', lambda u, b: u - b, (_PLACES,), 'b', 1),
    Form('{a} max({shift}, 0)', 'a * max(z - b, 0.0)', lambda u, b: np.maximum(u - b, 0.0), (_PLACES,), 'b', 1),
    Form('{a} max(-({shift}), 0)', 'a * max(b - z, 0.0)', lambda u, b: np.maximum(b - u, 0.0), (_PLACES,), 'b', 1),
    Form('{a} ({shift})^2', 'a * (z - b) * (z - b)', lambda u, b: (u - b) ** 2, (_PLACES,), 'b', 2),
    Form('{a} exp(-{z} / {c})', 'a * exp(-z / c)', lambda u, c: np.exp(-u / c), (_LENGTHS,), 'c', grows=-1.0),
    Form('{a} exp({z} / {c})', 'a * exp(z / c)', lambda u, c: np.exp(u / c), (_LENGTHS,), 'c', grows=1.0),
    Form(
        '{a} tanh(({shift}) / {c})',
        'a * tanh((z - b) / c)',
        lambda u, b, c: np.tanh((u - b) / c),
        (_PLACES, _LENGTHS),
        'bc',
    ),
    Form(
        '{a} exp(-(({shift}) / {c})^2)',
        'a * exp(-((z - b) / c) * ((z - b) / c))',
        lambda u, b, c: np.exp(-(((u - b) / c) ** 2)),
        (_HUMPS, _LENGTHS),
        'bc',
    ),
    Form(
        '{a} sin(2 pi ({shift}) / {c})',
        'a * wave((z - b) / c)[0]',
        lambda u, b, c: np.sin(2.0 * np.pi * (u - b) / c),
        ((0.0, 0.3), _WAVES),
        'bc',
    ),
)
"""From the simplest on: a height `a`, the variable `z`, its `shift` from a place `b`, a length `c`."""


def formulas(
    at: Array,
    value: Array,
    low: Array,
    high: Array,
    variable: str,
    *,
    free: bool,
    holds: Callable[[Formula], bool] = lambda formula: True,
) -> tuple[Formula, ...]:
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
    holds
        Tells whether one does when it is simulated in the curve's place.

    """
    if at.size < FEWEST_CURVE_POINTS:
        return ()
    middle, half = 0.5 * (at[0] + at[-1]), 0.5 * (at[-1] - at[0])
    u, weights = (at - middle) / half, 2.0 / np.maximum(high - low, LEAST_BAND * max(np.ptp(value), LEAST_CURVE_RANGE))
    found: list[tuple[int, float, Formula]] = []
    for form in GRAMMAR:
        if form.constant and not free:
            continue
        if found and 1 + len(form.starts) > found[0][0]:
            break
        numbers, height, constant = _fitted(form, u, value, weights, free)
        formula = _written(form, numbers, height, constant, middle, half, variable)
        told = formula.told(at)
        if np.all((told >= low) & (told <= high)) and holds(formula):
            found.append((1 + len(numbers), float(np.sum(((told - value) * weights) ** 2)), formula))
    found.sort(key=lambda one: one[1])
    return tuple(formula for _, _, formula in found[:MOST_FORMULAS])


def _fitted(form: Form, u: Array, value: Array, weights: Array, free: bool) -> tuple[Sequence[float], float, float]:
    """Return numbers, height and constant of a form that come nearest."""
    from scipy.optimize import least_squares  # takes long to import, and few need it

    def linear(numbers: Sequence[float] | Array) -> tuple[Array, Array]:
        columns = np.column_stack([form.function(u, *numbers), *([np.ones_like(u)] if free else [])])
        known, *_ = np.linalg.lstsq(columns * weights[:, None], value * weights, rcond=None)
        return np.asarray(known), (columns @ known - value) * weights

    def misfit(numbers: Sequence[float]) -> float:
        return float(np.sum(linear(numbers)[1] ** 2))

    def refined(start: Sequence[float]) -> Sequence[float]:
        lower, upper = ([_LIMITS[one][side] for one in form.has] for side in (0, 1))
        found = least_squares(lambda at: linear(at)[1], start, bounds=(lower, upper), max_nfev=MOST_FORMULA_EVALUATIONS)
        return tuple(found.x.tolist())

    starts = sorted(product(*form.starts), key=misfit)[:REFINED_STARTS]
    numbers = min(map(refined, starts), key=misfit) if form.has else ()
    known, _ = linear(numbers)
    return numbers, float(known[0]), float(known[1]) if free else 0.0


def _written(
    form: Form, numbers: Sequence[float], height: float, constant: float, middle: float, half: float, variable: str
) -> Formula:
    """Return a form with its numbers in SI units."""
    curve = partial(_curve, form, numbers, height, constant, middle, half)
    own = dict(zip(form.has, numbers))
    told = {name: number * half + (middle if name == 'b' else 0.0) for name, number in own.items()}
    told['a'] = height / half**form.power
    if form.grows:
        told['a'] *= float(np.exp(-form.grows * middle / told['c']))
    place = told.get('b', 0.0)
    shift = f'{variable} {"-" if place > 0.0 else "+"} {abs(place):.4g}'
    text = form.text.format(a=f'{told["a"]:.4g}', z=variable, shift=shift, c=f'{told.get("c", 1.0):.4g}')
    return Formula(text, form.code, {name: told[name] for name in f'a{form.has}'}, curve, form.power)


def _curve(
    form: Form, numbers: Sequence[float], height: float, constant: float, middle: float, half: float, at: Array
) -> Array:
    return np.asarray(height * form.function((at - middle) / half, *numbers) + constant)
