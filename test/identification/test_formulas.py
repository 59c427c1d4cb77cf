# SPDX-License-Identifier: Apache-2.0
"""The simplest formulas that stay within a curve's band."""

from __future__ import annotations

import numpy as np
import pytest

from cfd_pneumatic.identification.formulas import Formula, formulas

Z = np.linspace(-1.0, 2.0, 41)
LAWS = {
    '4 p': 4.0 * Z,
    '3 max(p - 0.5, 0)': 3.0 * np.maximum(Z - 0.5, 0.0),
    '3 max(-(p - 0.5), 0)': 3.0 * np.maximum(0.5 - Z, 0.0),
    '2 (p - 0.8)^2': 2.0 * (Z - 0.8) ** 2,
    '5 exp(-p / 0.7)': 5.0 * np.exp(-Z / 0.7),
    '5 exp(p / 0.7)': 5.0 * np.exp(Z / 0.7),
    '2 tanh((p - 0.4) / 0.3)': 2.0 * np.tanh((Z - 0.4) / 0.3),
    '2 exp(-((p + 0.2) / 0.5)^2)': 2.0 * np.exp(-(((Z + 0.2) / 0.5) ** 2)),
    '1 sin(2 pi (p - 0.1) / 1.3)': np.sin(2.0 * np.pi * (Z - 0.1) / 1.3),
}


def formulas_within(value: np.ndarray, half: float, *, has_free_constant: bool = True) -> tuple[Formula, ...]:
    return formulas(Z, value, value - half, value + half, 'p', has_free_constant=has_free_constant)


def evaluated(one: Formula) -> np.ndarray:
    """Return what a formula is at the points, as an effect has it."""
    names = {'exp': np.exp, 'tanh': np.tanh, 'max': np.maximum, 'wave': lambda turns: (np.sin(2.0 * np.pi * turns),)}
    return np.asarray(eval(one.code, {'__builtins__': {}}, {**names, 'z': Z, **one.numbers}))


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('constant', [0.0, 3.0])
def test_a_law_of_the_grammar_comes_back_but_for_a_constant(law: str, constant: float) -> None:
    value = LAWS[law]
    found = formulas_within(value + constant, 0.01 * np.ptp(value))
    assert found
    for one in found:
        left = evaluated(one) - value
        assert np.ptp(left) < 0.03 * np.ptp(value), one.text
    assert np.ptp(evaluated(found[0]) - value) < 2e-3 * np.ptp(value)


def test_the_simplest_form_is_told() -> None:
    assert [one.text for one in formulas_within(4.0 * Z, 0.1)] == ['4 p']
    hinge = LAWS['3 max(p - 0.5, 0)']
    assert [one.text for one in formulas_within(hinge, 0.05)] == ['3 max(p - 0.5, 0)']


def test_what_stays_within_no_band_has_no_formula() -> None:
    rough = np.random.default_rng(0).standard_normal(Z.size)
    assert formulas_within(rough, 0.1) == ()


def test_where_a_constant_counts_a_form_has_none() -> None:
    (line,) = formulas_within(4.0 * Z + 3.0, 0.1, has_free_constant=False)
    assert evaluated(line) == pytest.approx(4.0 * Z + 3.0, abs=1e-2)


def test_too_few_points_tell_none() -> None:
    assert formulas(Z[:4], Z[:4], Z[:4] - 1.0, Z[:4] + 1.0, 'x', has_free_constant=True) == ()
