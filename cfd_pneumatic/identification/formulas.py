# SPDX-License-Identifier: Apache-2.0
"""
Formulas for an estimated curve: the simplest formulas of a small grammar that stay within the curve's band.

The gains or the offset of the model may absorb a constant. The formula then determines the curve except for a constant.
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
    LEAST_SHARE_IN_BAND,
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
        Formula for people, with its numbers in SI units.
    code
        Expression for an effect's function, in the variable `z` and the names of the numbers.
    numbers
        Height `a`, and if the formula has them a place `b` and a length `c` of the variable [SI].
    evaluate
        Returns the formula's values at values of the variable, with the constant that fits best.
    power
        Power of the variable in the unit of the height.

    """

    text: str
    code: str
    numbers: Mapping[str, float]
    evaluate: Function = field(repr=False, compare=False)
    power: int = 0


@dataclass(frozen=True)
class Form:
    """
    A form of the grammar.

    Attributes
    ----------
    text, code
        As in `Formula`, with names for the numbers.
    function
        Function of the variable, from -1 to 1 over the range, and of the place and the length on this scale.
    starts
        Starting values of the place and the length, a choice each.
    letters
        Letters of these numbers: `b`, `c`.
    power
        Power of the variable in the unit of the height.
    growth
        Growth of an exponential's logarithm over a length [1].
    needs_free_constant
        Whether the form is used only if the model absorbs a constant.

    """

    text: str
    code: str
    function: Function
    starts: tuple[tuple[float, ...], ...] = ()
    letters: str = ''
    power: int = 0
    growth: float = 0.0
    needs_free_constant: bool = False


_PLACES = (-0.6, -0.2, 0.2, 0.6)
_LENGTHS = (0.2, 0.6)
_LIMITS = {'b': PLACE_BOUNDS, 'c': LENGTH_BOUNDS}

_HUMPS = (-0.6, -0.3, 0.0, 0.3, 0.6)
_WAVES = (0.5, 0.8, 1.2, 1.8)

GRAMMAR = (
    Form('{a} {z}', 'a * z', lambda u: u, power=1, needs_free_constant=True),
    Form('{a} ({shift})', 'a * (z - b)', lambda u, b: u - b, (_PLACES,), 'b', 1),
    Form('{a} max({shift}, 0)', 'a * max(z - b, 0.0)', lambda u, b: np.maximum(u - b, 0.0), (_PLACES,), 'b', 1),
    Form('{a} max(-({shift}), 0)', 'a * max(b - z, 0.0)', lambda u, b: np.maximum(b - u, 0.0), (_PLACES,), 'b', 1),
    Form('{a} ({shift})^2', 'a * (z - b) * (z - b)', lambda u, b: (u - b) ** 2, (_PLACES,), 'b', 2),
    Form('{a} exp(-{z} / {c})', 'a * exp(-z / c)', lambda u, c: np.exp(-u / c), (_LENGTHS,), 'c', growth=-1.0),
    Form('{a} exp({z} / {c})', 'a * exp(z / c)', lambda u, c: np.exp(u / c), (_LENGTHS,), 'c', growth=1.0),
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
"""Forms, the simplest first: height `a`, variable `z`, its `shift` from a place `b`, length `c`."""


def formulas(
    points: Array,
    value: Array,
    low: Array,
    high: Array,
    variable: str,
    *,
    has_free_constant: bool,
    is_accepted: Callable[[Formula], bool] = lambda formula: True,
) -> tuple[Formula, ...]:
    """
    Return the simplest formulas that mostly stay within a band, all with the same count of numbers.

    Parameters
    ----------
    points, value, low, high
        Variable, curve and band where recordings visited, shape (n,) [SI].
    variable
        Symbol of the variable.
    has_free_constant
        Whether the gains or the offset of the model absorb a constant.
    is_accepted
        Returns whether a formula fits when it is simulated instead of the curve.

    """
    if points.size < FEWEST_CURVE_POINTS:
        return ()
    middle, half = 0.5 * (points[0] + points[-1]), 0.5 * (points[-1] - points[0])
    u, weights = (
        (points - middle) / half,
        2.0 / np.maximum(high - low, LEAST_BAND * max(np.ptp(value), LEAST_CURVE_RANGE)),
    )
    accepted: list[tuple[int, float, Formula]] = []
    for form in GRAMMAR:
        if form.needs_free_constant and not has_free_constant:
            continue
        if accepted and 1 + len(form.starts) > accepted[0][0]:
            break
        numbers, height, constant = _fit(form, u, value, weights, has_free_constant)
        formula = _to_formula(form, numbers, height, constant, middle, half, variable)
        evaluated = formula.evaluate(points)
        is_within = (evaluated >= low) & (evaluated <= high)
        if np.mean(is_within) >= LEAST_SHARE_IN_BAND and is_accepted(formula):
            accepted.append((1 + len(numbers), float(np.sum(((evaluated - value) * weights) ** 2)), formula))
    accepted.sort(key=lambda ranked: ranked[1])
    return tuple(formula for _, _, formula in accepted[:MOST_FORMULAS])


def _fit(
    form: Form, u: Array, value: Array, weights: Array, has_free_constant: bool
) -> tuple[Sequence[float], float, float]:
    """Fit a form to a curve; return its numbers, height and constant."""
    from scipy.optimize import least_squares  # the import is slow, and few runs need it

    def linear(numbers: Sequence[float] | Array) -> tuple[Array, Array]:
        columns = np.column_stack([form.function(u, *numbers), *([np.ones_like(u)] if has_free_constant else [])])
        coefficients, *_ = np.linalg.lstsq(columns * weights[:, None], value * weights, rcond=None)
        return np.asarray(coefficients), (columns @ coefficients - value) * weights

    def misfit(numbers: Sequence[float]) -> float:
        return float(np.sum(linear(numbers)[1] ** 2))

    def refine(start: Sequence[float]) -> Sequence[float]:
        lower, upper = ([_LIMITS[letter][side] for letter in form.letters] for side in (0, 1))
        optimum = least_squares(
            lambda numbers: linear(numbers)[1], start, bounds=(lower, upper), max_nfev=MOST_FORMULA_EVALUATIONS
        )
        return tuple(optimum.x.tolist())

    starts = sorted(product(*form.starts), key=misfit)[:REFINED_STARTS]
    numbers = min(map(refine, starts), key=misfit) if form.letters else ()
    coefficients, _ = linear(numbers)
    return numbers, float(coefficients[0]), float(coefficients[1]) if has_free_constant else 0.0


def _to_formula(
    form: Form, numbers: Sequence[float], height: float, constant: float, middle: float, half: float, variable: str
) -> Formula:
    """Return a form as a formula with numbers in SI units."""
    curve = partial(_curve, form, numbers, height, constant, middle, half)
    scaled = dict(zip(form.letters, numbers))
    values = {letter: number * half + (middle if letter == 'b' else 0.0) for letter, number in scaled.items()}
    values['a'] = height / half**form.power
    if form.growth:
        values['a'] *= float(np.exp(-form.growth * middle / values['c']))
    place = values.get('b', 0.0)
    shift = f'{variable} {"-" if place > 0.0 else "+"} {abs(place):.4g}'
    text = form.text.format(a=f'{values["a"]:.4g}', z=variable, shift=shift, c=f'{values.get("c", 1.0):.4g}')
    return Formula(text, form.code, {letter: values[letter] for letter in f'a{form.letters}'}, curve, form.power)


def _curve(
    form: Form, numbers: Sequence[float], height: float, constant: float, middle: float, half: float, points: Array
) -> Array:
    return np.asarray(height * form.function((points - middle) / half, *numbers) + constant)
