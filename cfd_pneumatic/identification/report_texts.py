# SPDX-License-Identifier: Apache-2.0
"""Texts of results for people: names, sentences and numbers."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from cfd_pneumatic.model import CORES, EFFECTS

if TYPE_CHECKING:
    from cfd_pneumatic.identification.conclusion import Conclusion

TITLES = {'cylinder_a': 'Cylinder A', 'cylinder_b': 'Cylinder B', 'force': 'Contact force'}
"""Titles of the channels."""

VERDICTS = {
    'effect_added': 'Effect found',
    'no_missing_effect': 'Nothing missing',
    'shape_found': 'Unknown characteristic',
    'unexplained': 'Unexplained',
    'insufficient_data': 'Not enough data',
}
"""Short names of the verdicts."""

TESTS = {
    'inputs': 'Independent of the inputs',
    'slow_inputs': 'Independent of slow changes of the inputs',
    'line': 'No tone',
    'level': 'No drift',
    'ljung_box': 'No more autocorrelation than the noise at rest',
    'noise_floor': 'No larger than the noise',
}
"""Titles of the tests of a residual: the hypothesis that each test may reject."""

_LARGEST_ASYMMETRY = 0.1  # of an interval that is shown with ±, as a share
_SUPERSCRIPTS = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')


def readable_name(name: str) -> str:
    """Return an identifier with spaces."""
    return name.replace('set_point', 'set-point').replace('_', ' ')


def title(name: str) -> str:
    """Return the title of a cylinder or the force."""
    return TITLES.get(name, readable_name(name).capitalize())


def verdict(name: str) -> str:
    """Return the short name of a verdict."""
    return VERDICTS.get(name, readable_name(name).capitalize())


def reservation(findings: Conclusion) -> str:
    """Return the reservation that follows an uncertain verdict; empty for a confirmed verdict."""
    if findings.has_warning:
        return ', with a warning: check the data first'
    return ', with a hypothesis' if findings.status == 'hypothesis' else ''


def title_of_test(name: str) -> str:
    """Return the title of a test of a residual."""
    return TESTS.get(name, readable_name(name).capitalize())


def sentence(text: str) -> str:
    """Return a clause as a sentence: readable names of effects and cylinders, a capital letter and a full stop."""
    for name in sorted((*EFFECTS, *CORES), key=len, reverse=True):
        text = re.sub(rf'\b{name}\b', readable_name(name), text)
    text = re.sub(r'\bcylinder_([ab])\b', lambda match: f'cylinder {match[1].upper()}', text)
    text = re.sub(r'(\d) %', '\\1\u00a0%', text.strip())
    return text[:1].upper() + text[1:] + ('' if text.endswith(('.', '!', '?')) or not text else '.')


def unit(text: str) -> str:
    """Return a unit with raised powers: lbf/in³."""
    return re.sub(r'\^(-?\d+)', lambda match: match[1].translate(_SUPERSCRIPTS), text)


def number(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, as people write it: 4.31 × 10⁶."""
    if value == 0.0 or not math.isfinite(value):
        return f'{value:g}'
    power = math.floor(math.log10(abs(float(f'{value:.{digits - 1}e}'))))
    if -4 < power < 5:
        return f'{value:.{max(digits - 1 - power, 0)}f}'.replace('-', '−')
    mantissa = f'{value / 10.0**power:.{digits - 1}f}'
    return f'{mantissa} × 10{str(power).translate(_SUPERSCRIPTS)}'.replace('-', '−')


def percent(share: float) -> str:
    """Return a share in percent, with a space that does not break before the sign."""
    return f'{100.0 * share:.{0 if abs(share) >= 0.0995 else 1}f}\u00a0%'.replace('-', '−')


def uncertainty(value: float, interval: tuple[float, float]) -> str:
    """Return a 95 % interval for people: `± 2 %` if the interval is narrow and symmetric, else `3.1 to 4.9`."""
    below, above = value - interval[0], interval[1] - value
    if 0.0 < above < abs(value) and abs(above - below) < _LARGEST_ASYMMETRY * above:
        return f'± {number(100.0 * above / abs(value), 2)}\u00a0%'
    return f'{number(interval[0])} to {number(interval[1])}'
