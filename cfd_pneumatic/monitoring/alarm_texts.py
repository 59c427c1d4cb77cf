# SPDX-License-Identifier: Apache-2.0
"""Texts that describe alarms and their causes to people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from cfd_pneumatic.convention import CONTACT_FORCE
from cfd_pneumatic.identification import number, readable_name, title
from cfd_pneumatic.monitoring.finding import NewFindings
from cfd_pneumatic.monitoring.watch import Alarm
from cfd_pneumatic.monitoring.watched_signal import Departure, WatchedSignal

if TYPE_CHECKING:
    from cfd_pneumatic.identification import Estimate

_DIGITS = 3


def describe_departure(departure: Departure) -> str:
    """Describe how a signal departs from its model: `cylinder A loses 1.2 kPa more than its model at rest`."""
    name = title(departure.channel)
    name = name[:1].lower() + name[1:]
    if not departure.is_mean_shift:
        present, usual = (
            _format_amount(value, departure.channel) for value in (departure.root_mean_square, departure.usual_rms)
        )
        return f'{name} deviates from its model by {present} RMS (usual: {usual})'
    shift = departure.shift if departure.shift_at_rest is None else departure.shift_at_rest
    where = 'on average' if departure.shift_at_rest is None else 'at rest'
    amount = _format_amount(abs(shift), departure.channel)
    if departure.channel == CONTACT_FORCE:
        return f'{name} is {amount} {"below" if shift < 0.0 else "above"} its model {where}'
    return f'{name} {"loses" if shift < 0.0 else "holds"} {amount} more than its model {where}'


def describe_agreement(signal: WatchedSignal) -> str:
    """Describe a signal without an alarm."""
    misfit = signal.misfit
    if misfit is None:
        return 'agrees with its model'
    amount = _format_amount(abs(misfit), signal.name)
    side = 'above' if misfit > 0.0 else 'below'
    return f'is {amount} {side} its model since learning. Correct the parameters or set-points, then call ~/learn'


def describe_diagnosis(alarm: Alarm, follows: bool = False) -> str:
    """Describe the cause of an alarm; `follows` if it is on the force and pressures have alarms, too."""
    if alarm.failure is not None:
        return f'the cause is not determined ({alarm.failure})'
    if alarm.new_findings is None:
        return 'the diagnosis is running'
    if follows and not alarm.new_findings.effects:
        return 'follows from the pressures'
    return _describe_causes(alarm.new_findings)


def _describe_causes(findings: NewFindings) -> str:
    causes = [_describe_effect(name, alternatives, findings) for name, alternatives in findings.effects.items()]
    if findings.characteristic:
        causes.append(f'an unknown characteristic ({findings.characteristic})')
    if not causes:
        causes = [_describe_gain_change(before, after) for before, after in findings.gains.values()]
    if not causes:
        return 'no known effect explains it'
    further_cause = '. No known effect explains the remaining error' if findings.unexplained else ''
    return f'looks like {" and ".join(causes)}{further_cause}'


def _describe_effect(name: str, alternatives: Iterable[str], findings: NewFindings) -> str:
    sizes = [_format_estimate(estimate) for full, estimate in findings.estimates.items() if full.startswith(f'{name}.')]
    known_sizes = [size for size in sizes if size]
    size_text = f' ({", ".join(known_sizes)})' if known_sizes else ''
    suffix = ''.join(f' or {readable_name(effect)}' for effect in alternatives)
    return f'{readable_name(name)}{size_text}{suffix}' + (' (not distinguishable)' if suffix else '')


def _format_estimate(estimate: Estimate) -> str:
    """Format a parameter with its value and standard error; empty without a value."""
    if estimate.value is None:
        return ''
    name = readable_name(estimate.name.partition('.')[2])
    unit = '' if estimate.unit == '-' else f' {estimate.unit}'
    error = f' ± {number(estimate.std, 2)}' if estimate.std else ''
    return f'{name} {number(estimate.value, _DIGITS)}{error}{unit}'


def _describe_gain_change(before: Estimate, after: Estimate) -> str:
    values = [number(estimate.value, _DIGITS) for estimate in (before, after) if estimate.value is not None]
    return f'a change of {after.name} from {" to ".join(values)} {after.unit}'


def _format_amount(value: float, channel: str) -> str:
    """Format a pressure in Pa or kPa, or a force in N."""
    if channel == CONTACT_FORCE:
        return f'{number(value, 2)} N'
    return f'{number(value, 2)} Pa' if value < 999.5 else f'{number(value * 1e-3, 2)} kPa'
