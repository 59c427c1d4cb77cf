# SPDX-License-Identifier: Apache-2.0
"""How the watch puts it to people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from cfd_pneumatic.convention import CONTACT_FORCE
from cfd_pneumatic.identification import number, readable_name, title
from cfd_pneumatic.monitoring.finding import News
from cfd_pneumatic.monitoring.watch import Alarm
from cfd_pneumatic.monitoring.watched_signal import Departure, WatchedSignal

if TYPE_CHECKING:
    from cfd_pneumatic.identification import Estimate

_DIGITS = 3


def describe_departure(departure: Departure) -> str:
    """Return how a signal parts from its model: `cylinder A loses 1.2 kPa more than its model at rest`."""
    name = title(departure.channel)
    name = name[:1].lower() + name[1:]
    if not departure.level:
        now, usual = (_amount(value, departure.channel) for value in (departure.root_mean_square, departure.usual))
        return f'{name} parts from its model by {now} RMS, where {usual} are usual'
    shift = departure.shift if departure.at_rest is None else departure.at_rest
    where = 'on the average' if departure.at_rest is None else 'at rest'
    amount = _amount(abs(shift), departure.channel)
    if departure.channel == CONTACT_FORCE:
        return f'{name} is {amount} {"below" if shift < 0.0 else "above"} its model {where}'
    return f'{name} {"loses" if shift < 0.0 else "holds"} {amount} more than its model {where}'


def describe_agreement(channel: WatchedSignal) -> str:
    """Return what there is to say where there is no alarm."""
    misfit = channel.misfit
    if misfit is None:
        return 'agrees with its model'
    amount = _amount(abs(misfit), channel.name)
    side = 'above' if misfit > 0.0 else 'below'
    return f'is as it was while learning, {amount} {side} its model: check parameters and set-points, then learn anew'


def describe_diagnosis(alarm: Alarm, follows: bool = False) -> str:
    """Return what is known of the cause of an alarm; one on the force `follows` where pressures have parted, too."""
    if alarm.failure is not None:
        return f'which effect it is cannot be told ({alarm.failure})'
    if alarm.news is None:
        return 'is being diagnosed'
    if follows and not alarm.news.effects:
        return 'follows from the pressures'
    return _looks_like(alarm.news)


def _looks_like(news: News) -> str:
    causes = [_effect(name, others, news) for name, others in news.effects.items()]
    if news.law:
        causes.append(f'a law that is none of the effects known ({news.law})')
    if not causes:
        causes = [_change(before, after) for before, after in news.gains.values()]
    if not causes:
        return 'no effect that is known explains it'
    rest = ', and like something that no known effect explains' if news.unexplained else ''
    return f'looks like {" and ".join(causes)}{rest}'


def _effect(name: str, others: Iterable[str], news: News) -> str:
    sizes = [_sized(one) for full, one in news.estimates.items() if full.startswith(f'{name}.')]
    told = [size for size in sizes if size]
    sized = f' ({", ".join(told)})' if told else ''
    rivals = ''.join(f' or {readable_name(other)}' for other in others)
    return f'{readable_name(name)}{sized}{rivals}' + (' (not to be told apart)' if rivals else '')


def _sized(estimate: Estimate) -> str:
    """Return a parameter with its value and standard error."""
    if estimate.value is None:
        return ''
    name = readable_name(estimate.name.partition('.')[2])
    unit = '' if estimate.unit == '-' else f' {estimate.unit}'
    error = f' ± {number(estimate.std, 2)}' if estimate.std else ''
    return f'{name} {number(estimate.value, _DIGITS)}{error}{unit}'


def _change(before: Estimate, after: Estimate) -> str:
    values = [number(one.value, _DIGITS) for one in (before, after) if one.value is not None]
    return f'a change of {after.name} from {" to ".join(values)} {after.unit}'


def _amount(value: float, channel: str) -> str:
    """Return a pressure in Pa or kPa, or a force."""
    if channel == CONTACT_FORCE:
        return f'{number(value, 2)} N'
    return f'{number(value, 2)} Pa' if value < 999.5 else f'{number(value * 1e-3, 2)} kPa'
