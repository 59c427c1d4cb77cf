# SPDX-License-Identifier: Apache-2.0
"""The paper's tables, the parameter files made of them, and what an operating-point table refuses."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from cfd_pneumatic.model import NAMES, SPECS, TABLE_1, TABLE_2, OperatingPoints
from cfd_pneumatic.units import PSI, PSI_PER_INCH

CONFIG = Path(__file__).parents[2] / 'config'


def test_table_1_averages_its_repeats():
    np.testing.assert_allclose(TABLE_1.setpoints / PSI, [5.0, 10.0, 15.0, 20.0])
    np.testing.assert_allclose(TABLE_1.k_x[0] / PSI_PER_INCH, 0.5 * (16.0149 + 15.8753))
    np.testing.assert_allclose(TABLE_1.k_sv[1], 0.5 * (160.8374 + 168.2485))
    np.testing.assert_allclose(TABLE_1.tau, [0.01055, 0.0123, 0.0093, 0.005])


@pytest.mark.parametrize(('name', 'table'), [('table_1', TABLE_1), ('table_2', TABLE_2)])
def test_parameter_files_hold_the_tables(name, table):
    content = yaml.safe_load((CONFIG / f'{name}.yaml').read_text())['/**']['ros__parameters']
    for cylinder in ('cylinder_a', 'cylinder_b'):
        for field in ('setpoints', *NAMES):
            values = content[cylinder][field]
            assert all(isinstance(value, float) for value in values)
            np.testing.assert_allclose(values, getattr(table, field), rtol=1e-6)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'k_x': [1e6]}, 'k_x has 1 entries but setpoints has 2'),
        ({'k_sv': [1.0, np.nan]}, r'k_sv\[1\] = nan is outside 0.001 to 5000 1/s'),
        ({'tau': [0.01, -0.01]}, r'tau\[1\] = -0.01 is outside'),
        ({'setpoints': [2e4, 1e4]}, 'strictly increasing'),
        ({'setpoints': []}, 'setpoints is empty'),
    ],
)
def test_bad_tables_are_refused(change, message):
    rows = {'setpoints': [1e4, 2e4], 'k_x': [1e6, 2e6], 'k_sv': [10.0, 20.0], 'k_v': [5.0, 6.0], 'tau': [0.01, 0.01]}
    with pytest.raises(ValueError, match=message):
        OperatingPoints.from_rows(rows | change)


def test_a_table_covers_what_lies_between_and_near_its_set_points():
    for setpoint in (3.8, 10.0, 21.2):
        assert TABLE_1.covers(setpoint * PSI)
    for setpoint in (3.7, 21.3):
        assert not TABLE_1.covers(setpoint * PSI)
    assert OperatingPoints.constant(1e6, 10.0, 5.0, 0.01).covers(1e9)


def test_every_parameter_says_what_it_is():
    for spec in SPECS:
        assert 0.0 < spec.lower < spec.upper
        assert 'equation' in spec.description
        assert spec.unit
