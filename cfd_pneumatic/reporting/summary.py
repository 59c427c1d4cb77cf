# SPDX-License-Identifier: Apache-2.0
"""Summary of a channel's result in four short texts: what is missing, how sure, what it costs, what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import NamedTuple

from cfd_pneumatic.convention import PISTON_AREA
from cfd_pneumatic.device import force_per_speed
from cfd_pneumatic.identification import (
    PLACES,
    ChannelResult,
    Geometry,
    Identification,
    number,
    percent,
    readable_name,
    residual_dependences,
    sentence,
)
from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.notices import WARNING

_DIGITS = 2  # of forces and ratios
_LEAST_DIFFERENCE = 0.1  # between two directions that are reported apart, as a share


class Summary(NamedTuple):
    """The four texts, each of one to three short sentences."""

    missing: str
    """What the model lacks."""

    certainty: str
    """How sure the answer is."""

    cost: str
    """Force error on the recordings, and force error per piston speed."""

    next: str
    """What to inspect on the machine, or what to do next."""


def summarise(result: ChannelResult, identification: Identification) -> Summary:
    """Return the summary of a channel on which the loop was closed."""
    if result.findings.has_warning:
        return _doubtful_summary(result, identification)
    steps = ' '.join(_next_steps(result))
    return Summary(_missing(result), _certainty(result), _cost(result, identification.geometry), sentence(steps))


def _doubtful_summary(result: ChannelResult, identification: Identification) -> Summary:
    """Return the summary of a channel whose input data look wrong: the data check comes first."""
    warnings = [notice for notice in identification.notices if notice.level == WARNING]
    of_channel = [notice for notice in warnings if result.name in notice.message]
    notice = (of_channel or warnings)[0]
    return Summary(
        f'Check the data first: {sentence(notice.message)}',
        f'Uncertain. If the data are right: {_missing(result)}',
        'Not known before the data are right.',
        sentence(notice.fix),
    )


def noise_ratio(result: ChannelResult) -> float:
    """Return the error with effects over the sensor noise [-]."""
    return result.rmse(1) / result.noise.std


def _missing(result: ChannelResult) -> str:
    findings = result.findings
    named = _and([_with_alternatives(result, effect) for effect in findings.effects])
    plural = 's' if len(findings.effects) > 1 else ''
    if findings.verdict == 'insufficient_data':
        return sentence(findings.why)
    if findings.verdict == 'no_missing_effect':
        return f'Nothing is missing. The model explains the recording {_to_noise(result)}.'
    if findings.unknown is not None:
        more = f' Missing effect{plural}: {named}.' if named else ''
        return f'Unknown cause: {findings.unknown.cause}.{more}'
    if findings.verdict == 'unexplained':
        more = f' Part of it is {named}.' if named else ''
        size = f'Not explained. The error is {number(noise_ratio(result), _DIGITS)} times the sensor noise.'
        return ' '.join([f'{size}{more}', *map(sentence, findings.contradictions)])
    tied = ' This recording cannot distinguish them.' if any(findings.alternatives.values()) else ''
    return f'Missing effect{plural}: {named}.{tied}'


def _certainty(result: ChannelResult) -> str:
    findings = result.findings
    if findings.verdict == 'insufficient_data':
        return 'No answer: the recording is too short.'
    if findings.verdict == 'no_missing_effect':
        count = len(findings.not_visible)
        hidden = f' {count} effects could not show in this recording.' if count else ''
        return f'{_status(result)}{hidden}'
    if findings.verdict == 'unexplained' and not result.added:
        return 'No known effect explains it.' if findings.is_searched else 'Effects were not searched.'
    return f'{_status(result)}{_reduction(result)}'


def _status(result: ChannelResult) -> str:
    return 'Confirmed.' if result.findings.status == 'confirmed' else 'Hypothesis: more than sensor noise remains.'


def _reduction(result: ChannelResult) -> str:
    """Return by how much the effects reduce the error, and what remains, as sentences."""
    findings, ratio = result.findings, noise_ratio(result)
    if findings.ratio is None:
        return ''
    text = f' The error falls to {percent(findings.ratio)}'
    if findings.ratio_interval is not None:
        low, high = findings.ratio_interval
        text += f' ({100.0 * low:.0f} to {percent(high)})'
    if findings.status == 'confirmed':
        return f'{text}. Only sensor noise remains{f" ({number(ratio)} times)" if ratio > 1.0 else ""}.'
    return f'{text}, {number(ratio, _DIGITS)} times the sensor noise.'


def _to_noise(result: ChannelResult) -> str:
    ratio = noise_ratio(result)
    return 'down to sensor noise' if ratio <= 1.0 else f'to within {number(ratio)} times the sensor noise'


def _cost(result: ChannelResult, geometry: Geometry) -> str:
    """Return the force errors on the recording, and the force error per piston speed of a cylinder."""
    is_force = result.quantity.key == 'n'
    scale = 1.0 if is_force else force_per_pressure(geometry)
    before, after = (f'{number(scale * result.rmse(which), _DIGITS)} N' for which in (0, 1))
    text = f'The predicted force is {after} off.'
    if result.findings.effects or result.findings.unknown is not None:
        names = 'them' if len(result.findings.effects) > 1 else 'it'
        text = f'The predicted force is {before} off without {names}, {after} with {names}.'
    if is_force:
        return text
    speed = force_per_speed(result.found.model.parameters, scale)
    growing, shrinking = (f'{number(1e-3 * size, _DIGITS)} N' for size in speed)
    if abs(speed.growing - speed.shrinking) <= _LEAST_DIFFERENCE * speed.growing:
        text += f' Each mm/s of piston speed changes the force by {growing}.'
    else:
        text += f' Each mm/s of piston speed changes the force by {growing} (chamber grows) or {shrinking} (shrinks).'
    if geometry.area is None:
        text += f' Assumed piston area: {number(1e6 * PISTON_AREA)} mm².'
    return text


def force_per_pressure(geometry: Geometry) -> float:
    """Return piston area times geometric factor [N/Pa]; the default area if the area is not known."""
    area = PISTON_AREA if geometry.area is None else geometry.area
    return area * abs(1.0 if geometry.factor is None else geometry.factor)


def _next_steps(result: ChannelResult) -> Iterator[str]:
    """Yield what to inspect or to do, as sentences."""
    findings = result.findings
    if findings.verdict == 'insufficient_data':
        yield f'Record {findings.next_experiment}.'
        return
    if findings.unknown is not None:
        yield f'Inspect {PLACES[findings.unknown.enters].inspect}.'
    for effect in findings.effects:
        names = (effect, *findings.alternatives.get(effect, ()))
        yield f'Inspect {"; or ".join(dict.fromkeys(EFFECTS[name].inspect for name in names))}.'
    if findings.verdict == 'unexplained':
        dependences = residual_dependences(result)[:1] if findings.is_searched else []
        for dependence in dependences:
            yield f'The remaining error depends on {dependence.on}: {percent(dependence.share)}.'
            yield f'Inspect {dependence.suggestion}.'
        if not dependences:
            yield 'The remaining error depends on no single signal. Look at the plots of the residual.'
    elif not findings.effects and findings.unknown is None:
        yield 'No inspection is needed.'
    tied = {name: rivals for name, rivals in findings.alternatives.items() if rivals}
    advice = dict.fromkeys(EFFECTS[name].advice for name in (*tied, *chain(*tied.values())) if EFFECTS[name].advice)
    if advice:
        yield f'To decide, record {"; ".join(advice)}.'


def _with_alternatives(result: ChannelResult, effect: str) -> str:
    return ' or '.join(map(readable_name, (effect, *result.findings.alternatives.get(effect, ()))))


def _and(names: Sequence[str]) -> str:
    return ' and '.join(names)
