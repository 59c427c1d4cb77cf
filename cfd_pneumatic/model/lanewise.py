"""
Functions that a processor computes for all lanes of `composed` at once: no branches, no calls of a library.

They agree with the mathematical ones to 1e-13.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.kernel import kernel

_SATURATED = 19.0  # where tanh is one, but for rounding
_SQUARINGS = 7
_PARTS = 2.0**_SQUARINGS  # that an exponent is divided into
_NEAREST = 6755399441055744.0  # 1.5 * 2^52: added to a number it leaves no room for the digits behind the point
E2, E3, E4, E5, E6, E7, E8, E9, E10, E11 = (1.0 / math.factorial(n) for n in range(2, 12))
S1, S3, S5, S7, S9, S11, S13, S15, S17, S19 = (
    (-1.0) ** (n // 2) * math.pi**n / math.factorial(n) for n in range(1, 20, 2)
)
C2, C4, C6, C8, C10, C12, C14, C16, C18, C20 = (
    (-1.0) ** (n // 2) * math.pi**n / math.factorial(n) for n in range(2, 21, 2)
)


@kernel
def tanh(x):
    """Return the hyperbolic tangent."""
    z = min(max(x, -_SATURATED), _SATURATED) * (-2.0 / _PARTS)
    high = E6 + z * (E7 + z * (E8 + z * (E9 + z * (E10 + z * E11))))
    decay = 1.0 + z * (1.0 + z * (E2 + z * (E3 + z * (E4 + z * (E5 + z * high)))))
    for _ in range(_SQUARINGS):
        decay *= decay  # to e to the power of -2 x
    return (1.0 - decay) / (1.0 + decay)


@kernel
def wave(turns):
    """Return sine and cosine of an angle in turns."""
    x = turns - ((turns + _NEAREST) - _NEAREST)
    z = x * x
    high = S11 + z * (S13 + z * (S15 + z * (S17 + z * S19)))
    sine = x * (S1 + z * (S3 + z * (S5 + z * (S7 + z * (S9 + z * high)))))
    high = C10 + z * (C12 + z * (C14 + z * (C16 + z * (C18 + z * C20))))
    cosine = 1.0 + z * (C2 + z * (C4 + z * (C6 + z * (C8 + z * high))))
    return 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine  # of twice the angle
