# SPDX-License-Identifier: Apache-2.0
"""
Other ways to read recordings: the displacement counted the other way, the cylinders swapped, gauge for absolute.

Whoever mixes up signs or cylinders gets a pressure that does not follow the piston. Each other way is fitted without
effects, and the one that fits is named. Whoever mixes up references gets flows and stiffness of another pressure, which
only the physical core sees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.channels import Channel, Model, Pressure
from cfd_pneumatic.identification.conclusion import ratio_without_rests
from cfd_pneumatic.identification.data import AUTO, Experiment, Options, observed_motion, split_recordings
from cfd_pneumatic.identification.fit import Fit, Likelihood, find_optimum, fit_model
from cfd_pneumatic.identification.input_checks.recordings import scales
from cfd_pneumatic.identification.input_checks.setpoint_steps import with_steps
from cfd_pneumatic.identification.input_checks.thresholds import (
    CHAMBER_LENGTHS,
    GAUGE_PRESSURES,
    LARGEST_ALIKE_READING,
    LARGEST_READING_RATIO,
    LARGEST_RESIDUAL_SHARE,
    LARGEST_ROUGH_SCALE,
    LEAST_DIVISOR,
    LEAST_SCALE_DROP,
    LEAST_SCALE_EVIDENCE,
    LEAST_SENSITIVITY,
    LONGEST_READING,
    READING_SEARCH,
    STEP_ROUNDS,
)
from cfd_pneumatic.identification.residual import is_noise
from cfd_pneumatic.identification.result import ChannelResult
from cfd_pneumatic.identification.search import Candidates
from cfd_pneumatic.model import SPECS
from cfd_pneumatic.notices import Notice, warning
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

Reading = Callable[[Recording], Recording]


def is_misread(fits: Sequence[Fit]) -> bool:
    """
    Return whether a pressure hardly follows the piston, or not at all, in cylinders' fits without effects.

    How much is left says nothing where recordings span pressures: then the gains are wrong, and no reading.
    """

    def hardly(one: Fit) -> bool:
        return not one.spans_pressures and _left(one.simulated, one.likelihood) > LARGEST_RESIDUAL_SHARE

    return any(not one.estimates[0].identifiable or hardly(one) for one in fits)


def alternative_reading(recordings: Sequence[Recording], options: Options) -> Notice | None:
    """Return which other way of reading recordings fits, where theirs does not; None where none does."""
    some = [_beginning(one) for one in recordings]
    here = _worst(some, options)
    found = {}
    for name, reading in _readings(some).items():
        left = _worst([reading(one) for one in some], options)
        if left < min(LARGEST_RESIDUAL_SHARE, LARGEST_READING_RATIO * here):
            found[name] = left
    if not found:
        return None
    least = min(found.values())
    alike = [name for name, left in found.items() if left < LARGEST_ALIKE_READING * least]
    code = 'sign_suspect' if all('sign' in name for name in alike) else 'cylinders_swapped'
    fix = f'it fits {" or ".join(alike)}'
    if len(alike) > 1:
        fix += '; push the piston: where the displacement grows, the chamber of cylinder_a has to grow'
    return warning(code, 'the pressures do not follow the piston as it is read', fix)


def pressure_readings(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """
    Ask whether a pressure is a whole device's in another unit, or against another zero.

    Only that has the flows and the stiffness of its pressure. It is asked where something is left, and where what was
    found is a law or physics that the core has: those are what a wrong scale looks like. Where the core itself was
    found, another scale may leave noise as well, but clearly less; of noise that may have a memory nothing is clear.
    """
    conclusion = result.conclusion
    if options.core != AUTO or conclusion is None or not result.channel.cores:
        return
    (name, *_) = result.channel.cores
    physics = {*result.channel.effects[name].covers, *((result.channel.curve.name,) if conclusion.unknown else ())}
    found = result.found.model
    is_told = is_noise(conclusion.tests_after) and not physics & {*found.effects}
    if is_told and (not found.core or ratio_without_rests(conclusion.tests_after, has_rests=False)):
        return

    left_as_found = result.fit.likelihood.residuals(result.found.simulated)
    most = LARGEST_ROUGH_SCALE * float(np.mean(np.concatenate(left_as_found) ** 2))

    def by_core(scale: Scale) -> tuple[bool, float]:
        experiments = [scale.of(one) for one in result.experiments]
        try:
            alike = result.fit if scale.factor == 1.0 else fit_model(result.channel, experiments)
        except InputError:
            return False, math.inf
        candidates = Candidates(replace(alike.likelihood, experiments=tuple(experiments)), alike.model)
        begin = candidates.to_candidate(found, candidates.baseline.model) if is_told else candidates.baseline
        fitted = candidates.with_core(begin, name, most * scale.factor**2)
        return candidates.has_noise_residual(fitted), fitted.rss / scale.factor**2

    left = {}
    for scale in alternative_scales(result, recordings, options.ambient_pressure):
        is_explained, squares = by_core(scale)
        if is_explained:
            left[scale] = squares
    if not left:
        return
    best = min(left, key=left.__getitem__)
    is_explained_as_read, left_as_read = by_core(Scale())
    samples = sum(one.size for one in left_as_found)
    less = max(LEAST_SCALE_DROP, LEAST_SCALE_EVIDENCE / samples) if is_explained_as_read else 0.0
    if left[best] < (1.0 - less) * left_as_read:
        entries = ', '.join(f'`{key}: {value}`' for key, value in best.entries.items())
        yield warning(
            'unit_suspect' if 'unit' in best.entries else 'reference_suspect',
            f'{result.name}: its pressures look like {best.true} ones that are said to be {best.said}',
            f'check their {" and ".join(best.entries)}: with {entries} the model leaves '
            + ('clearly less' if is_explained_as_read else 'only noise'),
        )


@dataclass(frozen=True, eq=False)
class Scale:
    """
    What pressures may be counted in instead.

    Attributes
    ----------
    said, true
        What they are said to be, and what they would be, for people.
    entries
        Of a mapping, that differ then.
    factor, shift
        What makes pressures of those that were read [-, Pa].
    chamber
        How long it would make the chamber [m].

    """

    said: str = ''
    true: str = ''
    entries: Mapping[str, str] = field(default_factory=dict)
    factor: float = 1.0
    shift: float = 0.0
    chamber: float = 0.0

    def of(self, experiment: Experiment) -> Experiment:
        """Return an experiment with pressure and set-point on this scale."""
        measured, setpoint = (
            self.factor * one + self.shift for one in (experiment.measured, experiment.inputs['setpoint'])
        )
        return replace(experiment, measured=measured, inputs={**experiment.inputs, 'setpoint': setpoint})


def alternative_scales(result: ChannelResult, recordings: Sequence[Recording], ambient: float) -> Iterator[Scale]:
    """Yield the units and references that would make usual pressures and a usual chamber of a cylinder's."""
    signal = next(own for one in recordings if (own := result.channel.signal(one)) is not None)
    pressure = float(np.median(np.concatenate([one.measured for one in result.experiments])))
    lowest = min(float(np.min(one.inputs['setpoint'])) for one in result.experiments)
    sensitivity = result.channel.sensitivity(result.fit.model)
    said = signal.unit or 'Pa'
    for reference, unit, other, factor, shift in scales(signal, ambient):
        level = factor * pressure + shift
        chamber = level / (factor * sensitivity)
        if (
            GAUGE_PRESSURES[0] <= level - ambient <= GAUGE_PRESSURES[1]
            and factor * lowest + shift > ambient
            and CHAMBER_LENGTHS[0] <= chamber <= CHAMBER_LENGTHS[1]
        ):
            entries = {'unit': unit} if unit != said else {}
            entries |= {'reference': other} if other != reference else {}
            names = (f'{reference} {said}', f'{other} {unit}') if unit != said else (reference, other)
            yield Scale(*names, entries, factor, shift, chamber)


def force_error_share(
    recordings: Sequence[Recording], result: ChannelResult, options: Options, by: float = 0.0
) -> float:
    """Return which share of its spread a force's model leaves with the displacement's stamps moved [s]."""
    some = [_moved(_beginning(one), by) for one in recordings]
    return _left_by(result.channel, some, options, result.found.model)


def _moved(recording: Recording, by: float) -> Recording:
    signal = recording.displacement
    return replace(recording, displacement=Signal(signal.times + by, signal.values))


def _readings(recordings: Sequence[Recording]) -> dict[str, Reading]:
    """Return other ways to read recordings, by what they are; the sign of the force tells apart what fits alike."""
    other_way = 'with the other `sign` of the displacement'
    if not all(len(one.cylinders) == len(CYLINDERS) for one in recordings):
        return {other_way: _turned}
    readings: dict[str, Reading] = {}
    if any(own.setpoint is not None for one in recordings for own in one.cylinders.values()):
        readings['with the pressures of the two cylinders swapped'] = _pressures_swapped
        readings['with the set-points of the two cylinders swapped'] = lambda one: _swapped(_pressures_swapped(one))
    agrees = _force_agrees(recordings)
    if agrees is not False:
        readings[other_way] = _turned
    if agrees is not True:
        readings['with the two cylinders swapped'] = _swapped
    return readings


def _turned(recording: Recording) -> Recording:
    signal = recording.displacement
    return replace(recording, displacement=Signal(signal.times, -signal.values))


def _pressures_swapped(recording: Recording) -> Recording:
    a, b = (recording.cylinders[name] for name in CYLINDERS)
    swapped = (CylinderSignals(b.pressure, a.setpoint), CylinderSignals(a.pressure, b.setpoint))
    return replace(recording, cylinders=dict(zip(CYLINDERS, swapped)))


def _swapped(recording: Recording) -> Recording:
    a, b = (recording.cylinders[name] for name in CYLINDERS)
    return replace(recording, cylinders=dict(zip(CYLINDERS, (b, a))))


def _force_agrees(recordings: Sequence[Recording]) -> bool | None:
    """Return whether the force grows with the pressure in A less that in B; None where none was measured."""
    likeness = []
    for one in recordings:
        if one.force is not None:
            a, b = (np.interp(one.force.times, own.times, own.values) for own in _pressures(one))
            likeness.append(float(np.cov(a - b, one.force.values)[0, 1]))
    return sum(likeness) > 0.0 if likeness else None


def _pressures(recording: Recording) -> list[Signal]:
    return [recording.cylinders[name].pressure for name in CYLINDERS]


def _beginning(recording: Recording) -> Recording:
    """Return no more of a recording than is needed."""
    times = recording.displacement.times
    return recording if len(times) <= LONGEST_READING else recording.between(times[0], times[LONGEST_READING])


def _worst(recordings: Sequence[Recording], options: Options) -> float:
    """Return the share of its spread that the model leaves of the pressure that it fits worst."""
    try:
        return max(_left_by(one, recordings, options) for one in Pressure.found_in(recordings, options))
    except InputError:
        return math.inf


def _left_by(channel: Channel, recordings: Sequence[Recording], options: Options, start: Model | None = None) -> float:
    """Return what a rough fit of a channel's model leaves, as a share of the spread; it begins from its own starts."""
    held = [one for one in recordings if channel.signal(one) is not None]
    motions, strokes = zip(*(observed_motion(one) for one in held))
    splits, _ = split_recordings(list(strokes), options.fractions)
    experiments = [replace(channel.experiment(*one), index=rank) for rank, one in enumerate(zip(held, motions, splits))]
    likelihood = Likelihood.alike(channel, experiments)
    starts = channel.starts(experiments) if start is None else [start]
    best = min((find_optimum(likelihood, one, *READING_SEARCH) for one in starts), key=lambda one: one.cost)
    simulated = likelihood.simulate(best.model)
    left = _left(simulated, likelihood)
    for _ in range(STEP_ROUNDS if channel.name in CYLINDERS else 0):
        if all(one.cylinders[channel.name].setpoint is not None for one in held):
            break
        experiments = [with_steps(*one, channel) for one in zip(held, experiments, simulated)]
        likelihood = Likelihood.alike(channel, experiments)
        best = find_optimum(likelihood, best.model, *READING_SEARCH)
        simulated = likelihood.simulate(best.model)
        left = _left(simulated, likelihood)
        if best.model.parameters[0] < LEAST_SENSITIVITY * SPECS[0].lower:
            left = math.inf  # a staircase alone explains the pressure: that says nothing of the piston
    return left


def _left(simulated: Sequence[np.ndarray], likelihood: Likelihood) -> float:
    """Return the root mean square of what is left of a pressure, as a share of its spread."""
    left = np.concatenate([one.measured - values for one, values in zip(likelihood.experiments, simulated)])
    spread = np.concatenate([one.measured - np.mean(one.measured) for one in likelihood.experiments])
    return math.sqrt(float(left @ left) / max(float(spread @ spread), LEAST_DIVISOR))
