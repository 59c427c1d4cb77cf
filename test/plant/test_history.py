# SPDX-License-Identifier: Apache-2.0
"""When a device's verdict has changed, and when it only seems so."""

from __future__ import annotations

import pytest

from cfd_pneumatic.plant.history import devices

FINE = ('no_missing_effect', '', '')
LEAK = ('effect_added', 'leakage', '')
LEAK_OR_DROOP = ('effect_added', 'leakage', 'droop')
DROOP = ('effect_added', 'droop', '')
BOTH = ('effect_added', 'leakage;droop', '')
UNKNOWN = ('unexplained', 'leakage', '')
UNKNOWN_TOO = ('unexplained', 'droop', '')
LITTLE = ('insufficient_data', '', '')
FAILED = ('failed', '', '')


def device(*verdicts):
    """Return a device with one cylinder and a bag for each verdict, effects and alternatives."""
    rows = [
        {
            'device': 'cell',
            'bag': f'{rank}.mcap',
            'part': '' if verdict == 'failed' else 'cylinder_a',
            'verdict': verdict,
            'effects': effects,
            'alternatives': rivals,
        }
        for rank, (verdict, effects, rivals) in enumerate(verdicts)
    ]
    (found,) = devices(rows)
    return found


@pytest.mark.parametrize(('verdicts', 'changed_at'), [
    ([FINE, FINE], []),
    ([FINE, LEAK, LEAK], [1]),
    ([FINE, LEAK, FINE], [1, 2]),
    ([LEAK, DROOP], [1]),
    ([LEAK, BOTH], [1]),
    ([LEAK_OR_DROOP, DROOP], []),
    ([DROOP, LEAK_OR_DROOP], []),
    ([FINE, FAILED, LITTLE, FINE], []),
    ([FINE, FAILED, LITTLE, LEAK], [3]),
    ([LITTLE, LEAK], []),
    ([LEAK, UNKNOWN, UNKNOWN_TOO], [1]),
])  # fmt: skip
def test_a_change_is_another_verdict_or_effect_that_can_be_told(verdicts, changed_at):
    assert [int(change.after['bag'].split('.')[0]) for change in device(*verdicts).changes] == changed_at


def test_how_a_device_is_now_is_what_was_last_told():
    (part,) = device(FINE, LEAK, LITTLE, FAILED).parts
    assert part.latest['effects'] == 'leakage'
    (part,) = device(LITTLE).parts
    assert part.latest['verdict'] == 'insufficient_data'


def test_bags_that_failed_are_counted():
    found = device(FINE, FAILED, FAILED)
    assert (len(found.bags), len(found.failures), len(found.parts)) == (3, 2, 1)
    assert device(FAILED).parts == ()
