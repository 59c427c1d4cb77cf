# SPDX-License-Identifier: Apache-2.0
"""What is new in a finding, and how it is put."""

from __future__ import annotations

import pytest

from cfd_pneumatic.identification import Estimate
from cfd_pneumatic.monitoring import Alarm, Departure, Diagnosis, describe_departure, describe_diagnosis, new_findings


def estimate(name: str, value: float, std: float, unit: str = '1/s') -> Estimate:
    return Estimate(name, unit, value, std, (value - 2 * std, value + 2 * std), None)


def found(*estimates: Estimate, verdict: str = 'effect_added', **alternatives: tuple[str, ...]) -> Diagnosis:
    effects = tuple(dict.fromkeys(one.name.partition('.')[0] for one in estimates if '.' in one.name))
    return Diagnosis(verdict, '', effects, alternatives, {one.name: one for one in estimates})


LEAK = estimate('leakage.conductance', 0.42, 0.01)
LAW = Diagnosis('shape_found', '', (), {}, {}, 'the piston sticks: look at it')
K_SV = estimate('k_sv', 180.0, 1.0)


def said(now: Diagnosis, before: Diagnosis | None = None) -> str:
    return describe_diagnosis(Alarm(0, True, (0, 0), new_findings=new_findings(now, before)))


@pytest.mark.parametrize(
    ('now', 'before', 'words'),
    [
        (found(LEAK), None, 'looks like leakage (conductance 0.420 ± 0.010 1/s)'),
        (found(LEAK), found(LEAK), 'no known effect explains it'),
        (
            found(estimate('leakage.conductance', 0.84, 0.01)),
            found(LEAK),
            'looks like leakage (conductance 0.840 ± 0.010 1/s)',
        ),
        (
            found(LEAK, droop=(), leakage=('droop', 'set_point_drift')),
            found(verdict='no_missing_effect'),
            'looks like leakage (conductance 0.420 ± 0.010 1/s) or droop or set-point drift (not distinguishable)',
        ),
        (
            found(estimate('k_sv', 140.0, 1.0), verdict='no_missing_effect'),
            found(K_SV),
            'looks like a change of k_sv from 180 to 140 1/s',
        ),
        (found(estimate('k_sv', 182.0, 1.0)), found(K_SV), 'no known effect explains it'),
        (
            found(LEAK, verdict='unexplained'),
            None,
            'looks like leakage (conductance 0.420 ± 0.010 1/s). No known effect explains the remaining error',
        ),
        (found(verdict='unexplained'), None, 'no known effect explains it'),
        (LAW, None, 'looks like an unknown characteristic (the piston sticks: look at it)'),
        (LAW, LAW, 'no known effect explains it'),
    ],
)
def test_only_what_is_new_is_named(now: Diagnosis, before: Diagnosis | None, words: str) -> None:
    assert said(now, before) == words


@pytest.mark.parametrize(
    ('departure', 'words'),
    [
        (
            Departure('cylinder_a', 0, True, -700.0, -1200.0, 1200.0, 54.0),
            'cylinder A loses 1.2 kPa more than its model at rest',
        ),
        (
            Departure('cylinder_b', 0, True, 57.0, None, 80.0, 54.0),
            'cylinder B holds 57 Pa more than its model on average',
        ),
        (
            Departure('contact_force', 0, True, -0.8, None, 0.9, 0.1),
            'contact force is 0.80 N below its model on average',
        ),
        (
            Departure('cylinder_a', 0, False, 3.0, None, 350.0, 54.0),
            'cylinder A deviates from its model by 350 Pa RMS (usual: 54 Pa)',
        ),
    ],
)
def test_a_departure_is_said_in_words(departure: Departure, words: str) -> None:
    assert describe_departure(departure) == words
