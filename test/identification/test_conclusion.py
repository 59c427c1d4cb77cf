# SPDX-License-Identifier: Apache-2.0
"""Verdicts on errors that are hardly larger than the noise, and on a core that ends at its bounds."""

from __future__ import annotations

import pytest

from cfd_pneumatic.identification import Test as ResidualTest
from cfd_pneumatic.identification.conclusion import explained_to_within, verdict_of

ANY_SIZE = 1e9
DEPENDS = ResidualTest('inputs', 0.2, 0.1, 'dependence on the inputs')


def size(ratio):
    return ResidualTest('noise_floor', ratio, ANY_SIZE, 'root mean square of the residual over the noise')


def verdict(core='linear', effects=(), ratio=1.04, **options):
    return verdict_of(core, effects, {}, [size(ratio), DEPENDS], None, 0.5, (0.4, 0.6), **options)


@pytest.mark.parametrize(('ratio', 'within'), [(0.97, 1.0), (1.01, 1.05), (1.04, 1.05), (1.09, 1.1), (1.11, None)])
def test_the_ratio_is_rounded_up_to_twentieths(ratio, within):
    assert explained_to_within([size(ratio)]) == (None if within is None else pytest.approx(within))


def test_a_named_cause_holds_within_a_tenth_of_the_noise():
    name, why = verdict(effects=('leakage',))
    assert name == 'effect_added'
    assert 'The model explains the recording to within 1.05 times the noise' in why
    assert verdict(effects=('leakage',), ratio=1.2)[0] == 'unexplained'
    assert verdict()[0] == 'unexplained'


def test_a_core_with_several_parameters_at_bounds_is_not_reported_as_found():
    _, found = verdict(core='physical', ratio=3.0, core_bounds=('exponent',))
    assert found.startswith('The physical core is used')
    _, at_bounds = verdict(core='physical', ratio=3.0, core_bounds=('critical_ratio', 'control_volume'))
    assert 'does not describe this device: its parameters critical ratio and control volume end at' in at_bounds
    assert 'The physical core is used' not in at_bounds
