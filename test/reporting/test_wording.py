# SPDX-License-Identifier: Apache-2.0
"""Numbers and sentences for people."""

from __future__ import annotations

import pytest

from cfd_pneumatic.identification.report_texts import number, percent, readable_name, sentence, unit


@pytest.mark.parametrize(('value', 'digits', 'text'), [
    (4.312e6, 4, '4.312 × 10⁶'),
    (-1.5e-5, 2, '−1.5 × 10⁻⁵'),
    (0.01234, 3, '0.0123'),
    (99.996, 4, '100.0'),
    (99999.6, 4, '1.000 × 10⁵'),
    (12345.0, 3, '12345'),
    (0.0, 4, '0'),
    (float('inf'), 4, 'inf'),
])  # fmt: skip
def test_numbers_as_people_write_them(value, digits, text):
    assert number(value, digits) == text


def test_percent_stays_on_one_line():
    assert percent(0.232) == '23\u00a0%'
    assert percent(0.0123) == '1.2\u00a0%'
    assert percent(-0.5) == '−50\u00a0%'


def test_a_clause_becomes_a_sentence():
    assert sentence('the model lacks set_point_drift (or supply_variation)') == (
        'The model lacks set-point drift (or supply variation).'
    )
    assert sentence('') == ''


def test_names_and_units():
    assert readable_name('valve_dead_band') == 'valve dead band'
    assert unit('lbf/in^3') == 'lbf/in³'
    assert unit('N s/m') == 'N s/m'
