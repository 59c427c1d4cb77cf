"""From recordings to an identification: smooth, split, fit, judge."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.experiment import Experiment, make_experiment, observed_motion
from cfd_pneumatic.identification.data.force_experiment import make_force_experiment
from cfd_pneumatic.identification.data.motion import Motion
from cfd_pneumatic.identification.data.split import FRACTIONS, Split, split_recordings
from cfd_pneumatic.identification.fit.force import fit_area
from cfd_pneumatic.identification.fit.output_error import Fit, fit
from cfd_pneumatic.identification.force_loop import ForceClosure, close_force_loop
from cfd_pneumatic.identification.loop import Closure, close_loop
from cfd_pneumatic.identification.residual.noise import pressure_noise
from cfd_pneumatic.identification.verdict import PartError, part_errors
from cfd_pneumatic.recording import Recording
from cfd_pneumatic.recording.spool import parts

Array = NDArray[np.float64]
Masks = list[NDArray[np.bool_]]

Progress = Callable[[str, float], None]
"""Called with what is being done and which share of the whole is done [0 to 1]."""

_LEVEL_GAP = 0.03  # set-points closer than this share of the absolute pressure are one operating point


@dataclass(frozen=True)
class Options:
    """
    How to identify.

    Attributes
    ----------
    per_setpoint
        Fit an operating-point table, one row for each set-point, beside the joint fit.
    fractions
        Shares of train, validation and test.
    ambient_pressure
        What gauge pressures are counted from [Pa].
    close_loop
        Search for physical effects that the model lacks, in the force too where it was recorded.
    area
        About how large either piston is [m^2]; None if nobody knows.
    geometric_factor
        Contact force over piston force, from the linkage [-]; None if nobody knows: then it is in the area.

    """

    per_setpoint: bool = False
    fractions: tuple[float, float, float] = FRACTIONS
    ambient_pressure: float = AMBIENT_PRESSURE
    close_loop: bool = False
    area: float | None = None
    geometric_factor: float | None = None


@dataclass(frozen=True)
class Geometry:
    """
    How pressures make the contact force, as far as the recordings told it or somebody gave it.

    Attributes
    ----------
    area
        Of either piston [m^2]; None where nobody knows.
    factor
        Contact force over piston force that the area goes with [-]; None where nobody knows.
    note
        Why the area is not the recordings' own, or not known, for people to read; None where there is nothing to say.

    """

    area: float | None = None
    factor: float | None = None
    note: str | None = None


@dataclass(frozen=True)
class OperatingPoint:
    """A fit at one set-point, gauge [Pa]."""

    setpoint: float
    fit: Fit


@dataclass(frozen=True)
class CylinderResult:
    """
    What was found for one cylinder.

    Attributes
    ----------
    experiments
        The recordings made ready for the model.
    fit
        One joint fit, to train and validation together.
    schedule
        Fits at each set-point with `Options.per_setpoint`; otherwise the joint fit at the mean set-point.
    span
        Span p99 - p1 of the measured pressure, mean over recordings [Pa].
    noise_floor
        Standard deviation that measurement noise alone gives the residual [Pa].
    before
        Error on each part that has samples, by its name; by the schedule where there is one.
    notes
        Set-points that were left out, for people to read.
    closure
        What came of closing the loop; None where it wasn't asked for.
    after
        As `before`, by the model with the effects that were found; empty without a closure.

    """

    experiments: tuple[Experiment, ...]
    fit: Fit
    schedule: tuple[OperatingPoint, ...]
    span: float
    noise_floor: float
    before: Mapping[str, PartError]
    notes: tuple[str, ...]
    closure: Closure | None = None
    after: Mapping[str, PartError] = field(default_factory=dict)


@dataclass(frozen=True)
class Identification:
    """
    The result for all cylinders.

    Attributes
    ----------
    recordings
        What was identified.
    splits
        Where each recording was cut.
    no_test
        Why there is no test part, or None.
    cylinders
        Results by cylinder.
    ambient_pressure
        What gauge pressures are counted from [Pa].
    force
        What came of closing the loop on the contact force; None where it wasn't asked for or no force was recorded.
    no_force
        Why a force that was recorded told nothing, or None.
    geometry
        How pressures make the contact force.

    """

    recordings: tuple[Recording, ...]
    splits: tuple[Split, ...]
    no_test: str | None
    cylinders: Mapping[str, CylinderResult]
    ambient_pressure: float
    force: ForceClosure | None = None
    no_force: str | None = None
    geometry: Geometry = Geometry()


def _no_progress(_what: str, _share: float) -> None:
    return


def identify(
    recordings: Sequence[Recording], options: Options = Options(), progress: Progress = _no_progress
) -> Identification:
    """
    Identify each cylinder that the recordings hold, jointly over all of them.

    Raises
    ------
    InputError
        If a recording holds no motion or too few samples, or tells no parameter.

    """
    progress('smoothing the displacement', 0.0)
    motions, strokes = zip(*(observed_motion(recording) for recording in recordings))
    splits, no_test = split_recordings(list(strokes), options.fractions)
    present = [name for name in CYLINDERS if any(name in recording.cylinders for recording in recordings)]
    results = {}
    for rank, cylinder in enumerate(present):
        progress(f'fitting {cylinder}', (0.2 + rank) / (0.2 + len(present)))
        experiments = [
            make_experiment(recording, cylinder, motion, split)
            for recording, motion, split in zip(recordings, motions, splits)
            if cylinder in recording.cylinders
        ]
        try:
            results[cylinder] = _identify_cylinder(experiments, options)
        except InputError as error:
            raise InputError(f'{cylinder}: {error}') from error
    force, no_force, geometry = _identify_force(recordings, motions, splits, options)
    progress('done', 1.0)
    return Identification(
        tuple(recordings), tuple(splits), no_test, results, options.ambient_pressure, force, no_force, geometry
    )


def _identify_force(
    recordings: Sequence[Recording], motions: Sequence[Motion], splits: Sequence[Split], options: Options
) -> tuple[ForceClosure | None, str | None, Geometry]:
    """Return what came of closing the loop on the recorded force, why it told nothing, and what makes the force."""
    given = Geometry(options.area, options.geometric_factor, None if options.area is None else 'as given')
    if all(recording.force is None for recording in recordings):
        return None, None, given
    factor = 1.0 if options.geometric_factor is None else options.geometric_factor
    known = (options.ambient_pressure, options.area, factor)
    try:
        experiments = [
            make_force_experiment(recording, motion, split, options.ambient_pressure, thin=not options.close_loop)
            for recording, motion, split in zip(recordings, motions, splits)
            if recording.force is not None
        ]
        closure = close_force_loop(experiments, *known) if options.close_loop else None
        fit = fit_area(experiments, [one.fitted for one in experiments], *known) if closure is None else closure.fit
    except InputError as error:  # what the pressures tell stands without it
        no_force = f'force: {error}'
        return None, no_force, given if options.area is not None else replace(given, note=no_force)
    (area,) = (estimate for estimate in fit.estimates if estimate.name == 'area')
    return closure, None, Geometry(fit.area, fit.factor, area.reason)


def _identify_cylinder(experiments: Sequence[Experiment], options: Options) -> CylinderResult:
    fitted_to = [experiment.fitted for experiment in experiments]
    joint = fit(experiments, fitted_to)
    schedule = [OperatingPoint(_mean_level(experiments, joint) - options.ambient_pressure, joint)]
    simulated = list(joint.simulated)
    notes: list[str] = []
    if options.per_setpoint:
        schedule, simulated, notes = _fit_each_setpoint(experiments, fitted_to, joint, options)
    span = float(np.mean([experiment.span for experiment in experiments]))
    measured, part = [one.pressure for one in experiments], [one.part for one in experiments]
    closure = close_loop(experiments, joint, options.ambient_pressure) if options.close_loop else None
    return CylinderResult(
        experiments=tuple(experiments),
        fit=joint,
        schedule=tuple(schedule),
        span=span,
        noise_floor=pressure_noise(experiments, joint.simulated, joint.gains[0]).std,
        before=part_errors(measured, simulated, part),
        notes=tuple(notes),
        closure=closure,
        after=part_errors(measured, closure.simulated, part) if closure is not None else {},
    )


def _mean_level(experiments: Sequence[Experiment], joint: Fit) -> float:
    """Return the mean set-point [Pa]."""
    total = sum(
        float(np.sum(experiment.setpoint[experiment.samples[part]] + offset))
        for experiment, offset in zip(experiments, joint.offsets)
        for part in parts(experiment.samples, experiment.setpoint)
    )
    return total / sum(experiment.samples.size for experiment in experiments)


def _fit_each_setpoint(
    experiments: Sequence[Experiment], fitted_to: Masks, joint: Fit, options: Options
) -> tuple[list[OperatingPoint], list[Array], list[str]]:
    """
    Fit each set-point on its own; return the schedule, the pressures that it simulates, and what was left out.

    A recording that holds several set-points is simulated whole for each of them, and compared where it applies.
    """
    levels = [
        experiment.setpoint[experiment.samples] + offset for experiment, offset in zip(experiments, joint.offsets)
    ]
    simulated = [pressure.copy() for pressure in joint.simulated]
    schedule = []
    notes = []
    for low, high in _bands(np.concatenate(levels)):
        applies = [(low <= level) & (level <= high) for level in levels]
        used = [index for index, mask in enumerate(applies) if np.any(mask & fitted_to[index])]
        setpoint = float(np.mean(np.concatenate([levels[index][applies[index]] for index in used])))
        gauge = setpoint - options.ambient_pressure
        try:
            found = fit(
                [experiments[index] for index in used],
                [applies[index] & fitted_to[index] for index in used],
            )
        except InputError as error:
            notes.append(f'set-point {gauge:.0f} Pa left out of the schedule: {error}')
            continue
        schedule.append(OperatingPoint(gauge, found))
        for rank, index in enumerate(used):
            simulated[index][applies[index]] = found.simulated[rank][applies[index]]
    if not schedule:
        raise InputError('no set-point has data enough for a fit of its own: identify without --per-setpoint')
    return schedule, simulated, notes


def _bands(levels: Array) -> list[tuple[float, float]]:
    """Return lowest and highest level [Pa] of each group of neighbouring set-points, ascending."""
    values = np.unique(levels)
    gaps = np.flatnonzero(np.diff(values) > _LEVEL_GAP * values[:-1]) + 1
    return [(float(group[0]), float(group[-1])) for group in np.split(values, gaps)]
