# SPDX-License-Identifier: Apache-2.0
"""The prediction of a curve: places at which the simulation diverges promise nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cfd_pneumatic.identification.search.curve_places import CurvePlace
from cfd_pneumatic.identification.search.curve_screening import _COARSE, _screen

PLACE = CurvePlace('flow', 'x', 0.0, 0.0, 1.0, 0.5, 1.0, 1.0, 'curve')


@pytest.mark.parametrize('size', [1e200, math.inf, math.nan, 0.0])
def test_a_place_at_which_the_simulation_diverges_promises_nothing(size):
    changes = np.zeros((500, len(_COARSE)))
    changes[250:] = size
    screened = _screen(PLACE, np.ones(500), changes, 1.0)
    assert screened.evidence == -math.inf
    assert not np.any(screened.heights)
