# SPDX-License-Identifier: Apache-2.0
"""Summary of a channel's result in four short texts: diagnosis, how sure, force error, what to do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.convention import CYLINDERS, PISTON_AREA
from cfd_pneumatic.device import ForcePerSpeed, combined_force_per_speed, force_per_pressure, force_per_speed
from cfd_pneumatic.identification import (
    PLACES,
    ChannelResult,
    Conclusion,
    Identification,
    is_noise,
    number,
    percent,
    ratio_without_rests,
    readable_name,
    residual_dependences,
    sentence,
    title,
)
from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.notices import WARNING

_DIGITS = 2  # of forces and ratios
_NEAR_NOISE = 1.1  # times the noise, up to which an error counts as small
_LEAST_STDS = 3.0  # of an offset at rest that is reported, in standard errors
_FOLLOWED = {'time': 'time', 'position': 'the position of the piston', 'piston speed': 'the speed of the piston'}
_HYPOTHESIS = 'Hypothesis: more than sensor noise remains.'
_UNDECIDED = 'Only if the noise is autocorrelated. Record rests of one or two seconds to decide.'


LABELS = ('Diagnosis', 'How sure', 'Force error', 'What to do')
"""Labels of the texts of a summary."""


class Summary(NamedTuple):
    """The four texts, each of one to three short sentences."""

    diagnosis: str
    """What the model lacks, or that nothing is missing."""

    certainty: str
    """How sure the diagnosis is."""

    force_error: str
    """Force at rest, error of the predicted force on the recordings, and change of the force per piston speed."""

    next_steps: str
    """What to inspect on the machine, or what to do next."""


def summarise(result: ChannelResult, identification: Identification) -> Summary:
    """Return the summary of a channel on which the loop was closed."""
    if result.findings.has_warning:
        return _doubtful_summary(result, identification)
    steps = ' '.join(_next_steps(result))
    not_tested = () if result.findings.verdict == 'insufficient_data' else result.findings.not_tested
    certainty = ' '.join([_certainty(result), *map(sentence, not_tested)])
    return Summary(_diagnosis(result), certainty, _force_error(result, identification), sentence(steps))


def _doubtful_summary(result: ChannelResult, identification: Identification) -> Summary:
    """Return the summary of a channel whose input data look wrong: the data check comes first."""
    warnings = [notice for notice in identification.notices if notice.level == WARNING]
    of_channel = [notice for notice in warnings if result.name in notice.message]
    notice = (of_channel or warnings)[0]
    named = _named(result)
    return Summary(
        f'Check the data first. {sentence(notice.message)}',
        'Uncertain until the data are checked.' + (f' The answer would be {named}.' if named else ''),
        'Not known until the data are checked.',
        sentence(notice.fix),
    )


def noise_ratio(result: ChannelResult) -> float:
    """Return the error with effects over the sensor noise [-]."""
    return result.rmse(1) / result.noise.std


def _diagnosis(result: ChannelResult) -> str:
    findings, part = result.findings, _part(result)
    if findings.verdict == 'insufficient_data':
        return sentence(findings.why)
    if findings.verdict == 'no_missing_effect':
        if not is_noise(findings.tests_after) and findings.explained_to_within is None:
            return f'Within the tolerance. The model error of {part} is {_times_noise(result)}, and it is not noise.'
        return f'No fault found. The model explains the recording of {part} {_to_noise(result)}.'
    if findings.verdict == 'unexplained':
        known = ' and '.join(map(readable_name, findings.effects))
        more = f' {_capital(known)} can explain a part of the error.' if known else ''
        if findings.unknown is not None:
            more += f' An unknown characteristic can explain a part: {findings.unknown.cause}.'
        size = f'Not explained: the model error of {part} is {_times_noise(result)}.'
        if noise_ratio(result) < _NEAR_NOISE:
            size = f'Not explained: the model error of {part} is as small as the sensor noise, but it is not noise.'
        return ' '.join([f'{size}{more}', *map(sentence, findings.contradictions)])
    causes = [f'{_cause(result, effect)}{_share(findings, effect)}' for effect in findings.effects]
    if findings.unknown is not None:
        causes.insert(0, f'An unknown characteristic of {part}: {findings.unknown.cause}.')
    if len(causes) > 1:
        causes = [f'{rank}. {cause}' for rank, cause in enumerate(causes, start=1)]
        causes.insert(0, f'{len(causes)} causes.')
    return ' '.join(causes)


def _part(result: ChannelResult) -> str:
    """Return the name of a channel within a sentence."""
    if result.name in CYLINDERS:
        return f'cylinder {result.name[-1].upper()}'
    return f'the {title(result.name).lower()}'


def _share(findings: Conclusion, effect: str) -> str:
    """Return the share of the squared error that one of several effects explains, as a sentence; empty for one."""
    shares = {trial.effect: trial.rss_drop for trial in findings.tried if trial.accepted}
    if len(findings.effects) < 2 or effect not in shares:
        return ''
    remaining = 'remaining ' if effect != findings.effects[0] else ''
    return f' It explains {percent(shares[effect])} of the {remaining}squared error.'


def _cause(result: ChannelResult, effect: str) -> str:
    """Return an effect and its meaning as a sentence; tied effects together."""
    rivals = result.findings.alternatives.get(effect, ())
    if rivals:
        names = ' or '.join(map(readable_name, (effect, *rivals)))
        return f'{_capital(names)} in {_part(result)}. This recording cannot distinguish them.'
    where = f' in {_part(result)}' if result.quantity.key == 'pa' else ''
    return f'{_capital(readable_name(effect))}{where}: {result.channel.effects[effect].description.partition(":")[0]}.'


def _certainty(result: ChannelResult) -> str:
    findings = result.findings
    if findings.verdict == 'insufficient_data':
        return 'No answer: the recording is too short.'
    if findings.verdict == 'no_missing_effect':
        count = len(findings.not_visible)
        hidden = f' This recording could not show {count} of the known effects.' if count else ''
        if not is_noise(findings.tests_after):
            within = _within(findings)
            return f'{f"Hypothesis.{within}" if within else "Accepted by --tolerance."}{hidden}'
        return f'{_UNDECIDED if _may_be_more_than_noise(findings) else "Confirmed."}{hidden}'
    if findings.verdict == 'unexplained' and not findings.effects and findings.unknown is None:
        if not findings.is_searched:
            return 'No effect was searched, because the input data look wrong.'
        if findings.not_tried:
            return f'No answer yet: {unfinished(findings)}'
        return 'The error is real. All known effects were tried; none explains the error.'
    if findings.status != 'confirmed':
        doubt = _UNDECIDED if _may_be_more_than_noise(findings) else _HYPOTHESIS
        return f'{doubt} {_reduction(result)}{_within(findings)}'
    status = 'Confirmed.'
    if any(findings.alternatives.values()):
        status = 'Confirmed that one of them acts.'
        if len(findings.effects) > 1:
            status = 'Confirmed, except which of the effects acts that this recording cannot distinguish.'
    return f'{status} {_reduction(result)}{_within(findings)}'


def _within(findings: Conclusion) -> str:
    """Return within how many times the noise a recording is explained, as a sentence; empty if it is not."""
    size = findings.explained_to_within
    return '' if size is None or size <= 1.0 else f' Explained to within {size:.2f} times the noise.'


def unfinished(findings: Conclusion) -> str:
    """Return which parts of a search were not tried, as a sentence."""
    parts = ', '.join(findings.not_tried)
    named = re.sub(r'\w+', lambda word: readable_name(word[0]) if word[0] in EFFECTS else word[0], parts)
    return f'the search ended before it tried {named}. With --thorough it has no limit.'


def _may_be_more_than_noise(findings: Conclusion) -> bool:
    """Return whether only rests of the piston would show that the remaining error is noise."""
    without_rests = ratio_without_rests(findings.tests_after, findings.noise.known) is not None
    return without_rests and is_noise(findings.tests_after)


def _times_noise(result: ChannelResult) -> str:
    return f'{number(noise_ratio(result), _DIGITS)} times the sensor noise'


def _reduction(result: ChannelResult) -> str:
    """Return by how much the effects reduce the error of the model, as a sentence."""
    small, ratio = result.quantity.small, noise_ratio(result)
    before, after = (number(result.rmse(which) / small.si) for which in (0, 1))
    remainder = 'as small as the sensor noise' if ratio <= 1.0 else f'{number(ratio)} times the sensor noise'
    return f'With {_named(result)} in the model, its error falls from {before} to {after} {small.unit}, {remainder}.'


def _pronoun(named: str) -> str:
    return 'them' if ' and ' in named else 'it'


def _named(result: ChannelResult) -> str:
    curve = ['the curve'] if result.findings.unknown is not None else []
    return ' and '.join([*curve, *map(readable_name, result.findings.effects)])


def _to_noise(result: ChannelResult) -> str:
    ratio = noise_ratio(result)
    return 'down to sensor noise' if ratio <= 1.0 else f'to within {number(ratio)} times the sensor noise'


def _force_error(result: ChannelResult, identification: Identification) -> str:
    """Return the errors of the predicted force, and the change of the force per piston speed."""
    geometry = identification.geometry
    scale = 1.0 if result.quantity.key == 'n' else force_per_pressure(geometry)
    before, after = (f'{number(scale * result.rmse(which), _DIGITS)} N' for which in (0, 1))
    named = _named(result)
    text = f'Prediction: {after} (RMS) off.'
    if named:
        text = f'Prediction: {before} (RMS) off without {named} in the model, {after} with {_pronoun(named)}.'
    text = f'{_force_at_rest(result, identification)}{text}'
    speed = _force_per_speed(result, identification)
    growing, shrinking = (f'{number(1e-3 * size, _DIGITS)} N' for size in speed)
    force, chamber = 'the force', 'the chamber'
    if result.quantity.key == 'n':
        force, chamber = 'the contact force', 'chamber A'
    text += (
        f' As in every device, {force} follows the piston speed: {growing} lower per mm/s while {chamber} grows, '
        f'{shrinking} higher per mm/s while {chamber} shrinks.'
    )
    if geometry.area is None:
        text += f' Assumed piston area: {number(1e6 * PISTON_AREA)} mm². Give yours with identify_bag --area, in m².'
    return text


def _force_at_rest(result: ChannelResult, identification: Identification) -> str:
    """Return how far the force of a cylinder is from its set-point at rest, as a sentence; empty if not significant."""
    recorded = [
        rank
        for rank, comparison in enumerate(result.comparisons)
        if result.name in CYLINDERS
        and identification.recordings[comparison.recording].cylinders[result.name].setpoint is not None
    ]
    if not recorded:
        return ''
    offset = float(np.mean(result.fit.model.recording_values[recorded, 0]))
    std = float(np.max(result.fit.stds[recorded, 0]))
    if abs(offset) < max(_LEAST_STDS * std, result.noise.std):
        return ''
    size = number(force_per_pressure(identification.geometry) * abs(offset), _DIGITS)
    return f'At rest: {size} N {"above" if offset > 0.0 else "below"} the set-point. '


def _force_per_speed(result: ChannelResult, identification: Identification) -> ForcePerSpeed:
    """Return the force per piston speed of a cylinder, or of all cylinders for the contact force."""
    scale = force_per_pressure(identification.geometry)
    gains = {name: cylinder.found.model.parameters for name, cylinder in identification.cylinders.items()}
    return (
        force_per_speed(gains[result.name], scale)
        if result.quantity.key == 'pa'
        else combined_force_per_speed(gains, scale)
    )


def _next_steps(result: ChannelResult) -> Iterator[str]:
    """Yield what to inspect or to do, as sentences."""
    findings = result.findings
    if findings.verdict == 'insufficient_data':
        yield f'Record {findings.next_experiment}.'
        return
    if findings.unknown is not None:
        yield f'Inspect {PLACES[findings.unknown.enters].inspect}.'
    for effect in findings.effects:
        rivals = findings.alternatives.get(effect, ())
        for name in (effect, *rivals):
            place = EFFECTS[name].inspect or f'the cause of {readable_name(name)}'
            yield f'If {readable_name(name)}: inspect {place}.' if rivals else f'Inspect {place}.'
    if findings.verdict == 'unexplained':
        dependences = residual_dependences(result)[:1] if findings.is_searched else []
        for dependence in dependences:
            followed = _FOLLOWED.get(dependence.on, f'the {dependence.on}')
            yield (
                f'Look for a cause that follows {followed}, which explains {percent(dependence.share)} of the squared '
                f'error: inspect {dependence.suggestion}.'
            )
        if not dependences:
            yield 'No single signal explains the model error. Look at the plots of the residual.'
    elif not findings.effects and findings.unknown is None:
        yield 'No inspection is needed.'
    tied = {name: rivals for name, rivals in findings.alternatives.items() if rivals}
    advice = dict.fromkeys(EFFECTS[name].advice for name in (*tied, *chain(*tied.values())) if EFFECTS[name].advice)
    if advice:
        yield f'To decide, record {", and ".join(advice)}.'


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
