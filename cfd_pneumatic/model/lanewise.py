# SPDX-License-Identifier: Apache-2.0
"""Elementary functions of floats and of lanes, without branches; exact to about 1e-14."""

from __future__ import annotations

import math

from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import exponent, mantissa, power_of_two, where

_SATURATED = 19.0  # from here on tanh is 1 to rounding
_LEAST, _MOST = -708.0, 709.0  # exponentials of numbers beyond are zero or infinite
_SMALLEST = 2.3e-308  # below, floats lose digits
_NEAREST = 6755399441055744.0  # 1.5 * 2^52: adding this rounds a number to a whole number
_LN2 = math.log(2.0)
_LN2_HIGH = 6.93147180369123816490e-01  # few enough digits that the product with a whole number is exact
_LN2_LOW = 1.90821492927058770002e-10
E2, E3, E4, E5, E6, E7, E8, E9, E10, E11, E12, E13 = (1.0 / math.factorial(n) for n in range(2, 14))
L3, L5, L7, L9, L11, L13, L15, L17, L19, L21 = (2.0 / n for n in range(3, 22, 2))
S1, S3, S5, S7, S9, S11, S13, S15, S17, S19 = (
    (-1.0) ** (n // 2) * math.pi**n / math.factorial(n) for n in range(1, 20, 2)
)
C2, C4, C6, C8, C10, C12, C14, C16, C18, C20 = (
    (-1.0) ** (n // 2) * math.pi**n / math.factorial(n) for n in range(2, 21, 2)
)


@inlined
def nearest(x):
    """Return the nearest whole number."""
    return (x + _NEAREST) - _NEAREST


@inlined
def exp(x):
    """Return the exponential, limited to the range of floats."""
    inner = min(max(x, _LEAST), _MOST)
    whole = nearest(inner * (1.0 / _LN2))
    z = (inner - whole * _LN2_HIGH) - whole * _LN2_LOW
    z2 = z * z
    z4 = z2 * z2
    low = ((1.0 + z) + (E2 + E3 * z) * z2) + ((E4 + E5 * z) + (E6 + E7 * z) * z2) * z4
    high = ((E8 + E9 * z) + (E10 + E11 * z) * z2) + (E12 + E13 * z) * z4
    return (low + high * (z4 * z4)) * power_of_two(whole)


@inlined
def log(x):
    """Return the natural logarithm; at zero that of the smallest normal float."""
    positive = max(x, _SMALLEST)
    m = mantissa(positive)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    z2 = z * z
    z4 = z2 * z2
    low = ((2.0 + L3 * z) + (L5 + L7 * z) * z2) + ((L9 + L11 * z) + (L13 + L15 * z) * z2) * z4
    high = (L17 + L19 * z) + L21 * z2
    series = s * (low + high * (z4 * z4))
    return where(x >= 0.0, exponent(positive) * _LN2 + series, math.nan)


@inlined
def power(x, y):
    """Return x to the power of y; NaN if x is negative."""
    return exp(y * log(x))


@inlined
def tanh(x):
    """Return the hyperbolic tangent."""
    decay = exp(-2.0 * min(max(x, -_SATURATED), _SATURATED))
    return (1.0 - decay) / (1.0 + decay)


@inlined
def wave(turns):
    """Return sine and cosine of an angle in turns."""
    x = turns - nearest(turns)
    z = x * x
    high = S11 + z * (S13 + z * (S15 + z * (S17 + z * S19)))
    sine = x * (S1 + z * (S3 + z * (S5 + z * (S7 + z * (S9 + z * high)))))
    high = C10 + z * (C12 + z * (C14 + z * (C16 + z * (C18 + z * C20))))
    cosine = 1.0 + z * (C2 + z * (C4 + z * (C6 + z * (C8 + z * high))))
    return 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine  # double-angle formulas
