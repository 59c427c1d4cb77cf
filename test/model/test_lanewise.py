"""Functions for all lanes at once agree with the library's."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.model.lanewise import tanh, wave


@given(st.floats(-1e3, 1e3))
def test_tanh_is_the_hyperbolic_tangent(x):
    assert math.isclose(tanh(x), math.tanh(x), rel_tol=0.0, abs_tol=1e-13)


def test_tanh_has_no_steps():
    x = np.linspace(-25.0, 25.0, 5001)
    assert np.all(np.diff([tanh(one) for one in x]) >= -1e-14)


@given(st.integers(-10_000, 10_000), st.floats(-0.5, 0.5))
def test_a_wave_is_sine_and_cosine(whole, part):
    turns = whole + part
    angle = 2.0 * math.pi * (turns - whole)
    np.testing.assert_allclose(wave(turns), (math.sin(angle), math.cos(angle)), rtol=0.0, atol=1e-13)
