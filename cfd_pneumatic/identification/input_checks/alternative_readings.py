# SPDX-License-Identifier: Apache-2.0
"""
Test whether recordings fit better with the opposite sign, swapped cylinders, or another unit or reference.

With a wrong sign or swapped cylinders the pressure does not follow the piston. The model without effects is fitted to
each alternative, and the alternatives that fit are reported. With a wrong reference flows and stiffness belong to
another pressure, which only the physical core shows.
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
    Return whether a cylinder's pressure hardly follows the piston, from the fits without effects.

    A residual is no evidence if the recordings span pressures: then constant gains cause the residual.
    """

    def is_poor(fit: Fit) -> bool:
        return not fit.spans_pressures and _residual_share(fit.simulated, fit.likelihood) > LARGEST_RESIDUAL_SHARE

    return any(not fit.estimates[0].identifiable or is_poor(fit) for fit in fits)


def alternative_reading(recordings: Sequence[Recording], options: Options) -> Notice | None:
    """Return a warning that names the readings that fit much better than the recordings as read; None without any."""
    beginnings = [_beginning(recording) for recording in recordings]
    share_as_read = _largest_residual_share(beginnings, options)
    shares = {}
    for name, reading in _readings(beginnings).items():
        share = _largest_residual_share([reading(recording) for recording in beginnings], options)
        if share < min(LARGEST_RESIDUAL_SHARE, LARGEST_READING_RATIO * share_as_read):
            shares[name] = share
    if not shares:
        return None
    least = min(shares.values())
    alike = [name for name, share in shares.items() if share < LARGEST_ALIKE_READING * least]
    code = 'sign_suspect' if all('sign' in name for name in alike) else 'cylinders_swapped'
    fix = f'the model fits {" or ".join(alike)}'
    if len(alike) > 1:
        fix += '; push the piston by hand: the chamber of cylinder_a must grow when the displacement grows'
    return warning(code, 'the pressures do not follow the recorded motion of the piston', fix)


def check_scales(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """
    Warn if the physical core fits the pressures clearly better in another unit or reference.

    Flows and stiffness depend on the absolute pressure, in the physical core alone. A wrong scale looks like an
    unexplained residual, an unknown curve, or effects that the core covers: only then scales are compared. If the
    search found the core, both scales may leave noise, and the residual must be clearly smaller with the other scale.
    Autocorrelated noise permits no such comparison.
    """
    conclusion = result.conclusion
    if options.core != AUTO or conclusion is None or not result.channel.cores:
        return
    (name, *_) = result.channel.cores
    physics = {*result.channel.effects[name].covers, *((result.channel.curve.name,) if conclusion.unknown else ())}
    found = result.found.model
    is_explained = is_noise(conclusion.tests_after) and not physics & {*found.effects}
    if is_explained and (not found.core or ratio_without_rests(conclusion.tests_after, has_rests=False)):
        return

    residuals = result.fit.likelihood.residuals(result.found.simulated)
    largest_rough_square = LARGEST_ROUGH_SCALE * float(np.mean(np.concatenate(residuals) ** 2))

    def fit_core(scale: Scale) -> tuple[bool, float]:
        experiments = [scale.rescaled(experiment) for experiment in result.experiments]
        try:
            linear = result.fit if scale.factor == 1.0 else fit_model(result.channel, experiments)
        except InputError:
            return False, math.inf
        candidates = Candidates(replace(linear.likelihood, experiments=tuple(experiments)), linear.model)
        begin = candidates.to_candidate(found, candidates.baseline.model) if is_explained else candidates.baseline
        fitted = candidates.with_core(begin, name, largest_rough_square * scale.factor**2)
        return candidates.has_noise_residual(fitted), fitted.rss / scale.factor**2

    squares_by_scale = {}
    for scale in alternative_scales(result, recordings, options.ambient_pressure):
        leaves_noise, squares = fit_core(scale)
        if leaves_noise:
            squares_by_scale[scale] = squares
    if not squares_by_scale:
        return
    best = min(squares_by_scale, key=squares_by_scale.__getitem__)
    leaves_noise_as_read, squares_as_read = fit_core(Scale())
    samples = sum(residual.size for residual in residuals)
    least_drop = max(LEAST_SCALE_DROP, LEAST_SCALE_EVIDENCE / samples) if leaves_noise_as_read else 0.0
    if squares_by_scale[best] < (1.0 - least_drop) * squares_as_read:
        entries = ', '.join(f'`{key}: {value}`' for key, value in best.entries.items())
        yield warning(
            'unit_suspect' if 'unit' in best.entries else 'reference_suspect',
            f'{result.name}: the pressures are read as {best.assumed}, but look like {best.likely}',
            f'check their {" and ".join(best.entries)}: with {entries} the remaining error is '
            + ('clearly smaller' if leaves_noise_as_read else 'only noise'),
        )


@dataclass(frozen=True, eq=False)
class Scale:
    """
    A unit and a reference in which pressures may have been recorded.

    Attributes
    ----------
    assumed, likely
        Unit or reference that the mapping states, and the alternative, for people.
    entries
        Entries of a mapping that the alternative changes.
    factor, shift
        Convert the pressures as read to the alternative [-, Pa].
    chamber
        Chamber length with the alternative [m].

    """

    assumed: str = ''
    likely: str = ''
    entries: Mapping[str, str] = field(default_factory=dict)
    factor: float = 1.0
    shift: float = 0.0
    chamber: float = 0.0

    def rescaled(self, experiment: Experiment) -> Experiment:
        """Return an experiment with pressure and set-point on this scale."""
        measured, setpoint = (
            self.factor * values + self.shift for values in (experiment.measured, experiment.inputs['setpoint'])
        )
        return replace(experiment, measured=measured, inputs={**experiment.inputs, 'setpoint': setpoint})


def alternative_scales(result: ChannelResult, recordings: Sequence[Recording], ambient: float) -> Iterator[Scale]:
    """Yield the units and references with which a cylinder's pressures and chamber length are usual."""
    signals = map(result.channel.signal, recordings)
    signal = next(signal for signal in signals if signal is not None)
    pressure = float(np.median(np.concatenate([experiment.measured for experiment in result.experiments])))
    lowest = min(float(np.min(experiment.inputs['setpoint'])) for experiment in result.experiments)
    sensitivity = result.channel.sensitivity(result.fit.model)
    declared_unit = signal.unit or 'Pa'
    for declared_reference, unit, reference, factor, shift in scales(signal, ambient):
        level = factor * pressure + shift
        chamber = level / (factor * sensitivity)
        if (
            GAUGE_PRESSURES[0] <= level - ambient <= GAUGE_PRESSURES[1]
            and factor * lowest + shift > ambient
            and CHAMBER_LENGTHS[0] <= chamber <= CHAMBER_LENGTHS[1]
        ):
            entries = {'unit': unit} if unit != declared_unit else {}
            entries |= {'reference': reference} if reference != declared_reference else {}
            names = (declared_reference, reference)
            if unit != declared_unit:
                names = (f'{declared_reference} {declared_unit}', f'{reference} {unit}')
            yield Scale(*names, entries, factor, shift, chamber)


def force_error_share(
    recordings: Sequence[Recording], result: ChannelResult, options: Options, shift: float = 0.0
) -> float:
    """Return the residual of a force's model, as a share of its spread, with the displacement's stamps shifted [s]."""
    beginnings = [_shift_displacement(_beginning(recording), shift) for recording in recordings]
    return _fitted_residual_share(result.channel, beginnings, options, result.found.model)


def _shift_displacement(recording: Recording, shift: float) -> Recording:
    signal = recording.displacement
    return replace(recording, displacement=Signal(signal.times + shift, signal.values))


def _readings(recordings: Sequence[Recording]) -> dict[str, Reading]:
    """Return alternative readings by name; a measured force excludes either the opposite sign or swapped cylinders."""
    opposite_sign = 'with the opposite `sign` of the displacement'
    if not all(len(recording.cylinders) == len(CYLINDERS) for recording in recordings):
        return {opposite_sign: _reverse_displacement}
    readings: dict[str, Reading] = {}
    cylinders = [signals for recording in recordings for signals in recording.cylinders.values()]
    if any(signals.setpoint is not None for signals in cylinders):
        readings['with the pressures of the two cylinders swapped'] = _swap_pressures
        readings['with the set-points of the two cylinders swapped'] = lambda recording: _swap_cylinders(
            _swap_pressures(recording)
        )
    agrees = _force_agrees(recordings)
    if agrees is not False:
        readings[opposite_sign] = _reverse_displacement
    if agrees is not True:
        readings['with the two cylinders swapped'] = _swap_cylinders
    return readings


def _reverse_displacement(recording: Recording) -> Recording:
    signal = recording.displacement
    return replace(recording, displacement=Signal(signal.times, -signal.values))


def _swap_pressures(recording: Recording) -> Recording:
    a, b = (recording.cylinders[name] for name in CYLINDERS)
    swapped = (CylinderSignals(b.pressure, a.setpoint), CylinderSignals(a.pressure, b.setpoint))
    return replace(recording, cylinders=dict(zip(CYLINDERS, swapped)))


def _swap_cylinders(recording: Recording) -> Recording:
    a, b = (recording.cylinders[name] for name in CYLINDERS)
    return replace(recording, cylinders=dict(zip(CYLINDERS, (b, a))))


def _force_agrees(recordings: Sequence[Recording]) -> bool | None:
    """Return whether the force grows with the pressure difference A minus B; None if no force was measured."""
    covariances = []
    for recording in recordings:
        force = recording.force
        if force is not None:
            a, b = (np.interp(force.times, signal.times, signal.values) for signal in _pressures(recording))
            covariances.append(float(np.cov(a - b, force.values)[0, 1]))
    return sum(covariances) > 0.0 if covariances else None


def _pressures(recording: Recording) -> list[Signal]:
    return [recording.cylinders[name].pressure for name in CYLINDERS]


def _beginning(recording: Recording) -> Recording:
    """Return the beginning of a recording, at most `LONGEST_READING` samples long."""
    times = recording.displacement.times
    return recording if len(times) <= LONGEST_READING else recording.between(times[0], times[LONGEST_READING])


def _largest_residual_share(recordings: Sequence[Recording], options: Options) -> float:
    """Return the largest residual of a pressure, as a share of its spread; infinite if no model can be fitted."""
    try:
        channels = Pressure.found_in(recordings, options)
        return max(_fitted_residual_share(channel, recordings, options) for channel in channels)
    except InputError:
        return math.inf


def _fitted_residual_share(
    channel: Channel, recordings: Sequence[Recording], options: Options, start: Model | None = None
) -> float:
    """Return the residual of a rough fit from `start`, by default without effects, as a share of the spread."""
    recordings = [recording for recording in recordings if channel.signal(recording) is not None]
    motions, strokes = zip(*(observed_motion(recording) for recording in recordings))
    splits, _ = split_recordings(list(strokes), options.fractions)
    experiments = [
        replace(channel.experiment(*prepared), index=index)
        for index, prepared in enumerate(zip(recordings, motions, splits))
    ]
    likelihood = Likelihood.alike(channel, experiments)
    starts = channel.starts(experiments) if start is None else [start]
    optima = (find_optimum(likelihood, model, *READING_SEARCH) for model in starts)
    best = min(optima, key=lambda optimum: optimum.cost)
    simulated = likelihood.simulate(best.model)
    share = _residual_share(simulated, likelihood)
    for _ in range(STEP_ROUNDS if channel.name in CYLINDERS else 0):
        if all(recording.cylinders[channel.name].setpoint is not None for recording in recordings):
            break
        experiments = [with_steps(*fitted, channel) for fitted in zip(recordings, experiments, simulated)]
        likelihood = Likelihood.alike(channel, experiments)
        best = find_optimum(likelihood, best.model, *READING_SEARCH)
        simulated = likelihood.simulate(best.model)
        share = _residual_share(simulated, likelihood)
        if best.model.parameters[0] < LEAST_SENSITIVITY * SPECS[0].lower:
            share = math.inf  # the steps alone explain the pressure: that is no evidence for the motion
    return share


def _residual_share(simulated: Sequence[np.ndarray], likelihood: Likelihood) -> float:
    """Return the root mean square of the residual, as a share of the measured standard deviation."""
    experiments = likelihood.experiments
    residual = np.concatenate([experiment.measured - values for experiment, values in zip(experiments, simulated)])
    spread = np.concatenate([experiment.measured - np.mean(experiment.measured) for experiment in experiments])
    return math.sqrt(float(residual @ residual) / max(float(spread @ spread), LEAST_DIVISOR))
