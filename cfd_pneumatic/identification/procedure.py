# SPDX-License-Identifier: Apache-2.0
"""From recordings to an identification: smooth, split, fit, judge."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.channels import Channel, channels_of
from cfd_pneumatic.identification.conclusion import part_errors
from cfd_pneumatic.identification.data import (
    FRACTIONS,
    PHYSICAL,
    Experiment,
    Motion,
    Options,
    Split,
    observed_motion,
    split_recordings,
)
from cfd_pneumatic.identification.fit import Fit, fit_model
from cfd_pneumatic.identification.input_checks import (
    alternative_reading,
    check_recordings,
    check_results,
    hides_effects,
    is_misread,
    ripple_notice,
    ripple_of,
    steps_of_fit,
    steps_of_pressure,
)
from cfd_pneumatic.identification.loop import close_loop
from cfd_pneumatic.identification.result import ChannelResult, Comparison, Identification, OperatingPoint
from cfd_pneumatic.identification.search import with_core
from cfd_pneumatic.identification.thresholds import LARGEST_SETPOINT_GAP, MOST_SAMPLES_TOGETHER
from cfd_pneumatic.notices import WARNING, Notice, SuspectError, any_warning, note
from cfd_pneumatic.recording import Recording, split_at_gaps
from cfd_pneumatic.runtime import map_in_threads

Progress = Callable[[str, float], None]
"""Called with what is being done and which share of the whole is done [0 to 1]."""

_SMOOTHED = 0.06  # share of the whole


@dataclass(frozen=True)
class Prepared:
    """
    Recordings with their smoothed displacement.

    Attributes
    ----------
    recordings, motions
        What was recorded, and how the piston moved.
    splits, no_test
        Where each recording is cut, and why there is no test part, or None.

    """

    recordings: tuple[Recording, ...]
    motions: tuple[Motion, ...]
    splits: tuple[Split, ...]
    no_test: str | None

    def holding(self, channel: Channel) -> tuple[int, ...]:
        """Return the indices of the recordings that hold a channel."""
        return tuple(index for index, one in enumerate(self.recordings) if channel.signal(one) is not None)

    def experiments(self, channel: Channel) -> tuple[Experiment, ...]:
        """Return a channel's experiments, one for each recording that holds it."""
        return tuple(
            replace(channel.experiment(self.recordings[index], self.motions[index], self.splits[index]), index=rank)
            for rank, index in enumerate(self.holding(channel))
        )


def prepare_recordings(recordings: Sequence[Recording], fractions: tuple[float, float, float] = FRACTIONS) -> Prepared:
    """
    Return recordings with the displacement smoothed, and cut into parts.

    Raises
    ------
    InputError
        If a recording holds no motion or too few samples.

    """
    motions, strokes = zip(*(observed_motion(recording) for recording in recordings))
    splits, no_test = split_recordings(list(strokes), fractions)
    return Prepared(tuple(recordings), tuple(motions), tuple(splits), no_test)


def identify(
    recordings: Sequence[Recording], options: Options = Options(), progress: Progress = lambda _what, _share: None
) -> Identification:
    """
    Identify each channel that the recordings hold, jointly over all of them.

    What a channel beside the cylinders does not tell does not keep the others from telling. What lies between the gaps
    of a recording is identified as a recording of its own.

    Raises
    ------
    InputError
        If there is no recording, one holds no motion or too few samples, or a cylinder tells no parameter.

    """
    if not recordings:
        raise InputError('there is no recording to identify: give one or more')
    recordings = [piece for recording in recordings for piece in split_at_gaps(recording)]
    progress('smoothing the displacement', 0.0)
    try:
        data = prepare_recordings(recordings, options.fractions)
    except InputError as error:
        raise _with_what_it_looks_like(error, recordings, options) from error
    channels = channels_of(recordings, options)
    waiting = [channel.name for channel in channels]
    progress(f'fitting {", ".join(waiting)}', _SMOOTHED)

    samples = sum(len(recording.displacement.times) for recording in recordings)
    together = map_in_threads if samples <= MOST_SAMPLES_TOGETHER else map  # one after the other where memory counts
    fits = dict(zip(waiting, together(lambda channel: _fitted(channel, data), channels)))
    even, uneven = _without_waves(data, fits, channels, options)
    if uneven:
        data = even
        fits = dict(zip(waiting, together(lambda channel: _fitted(channel, data), channels)))
    failed = {name: one for name, one in fits.items() if isinstance(one, InputError)}
    fitted = {channel: one for channel in channels if isinstance(one := fits[channel.name], Fit)}
    needed = {channel: fits[channel.name] for channel in channels if channel.needed}
    untold = [one for one in needed.values() if isinstance(one, InputError)]
    doubtful = bool(untold) or is_misread([one for one in needed.values() if isinstance(one, Fit)])
    other = alternative_reading(recordings, options) if doubtful else None
    seen = {name: [other] for name in waiting} if other else _steps(needed, data, options)
    seen_in_any = list(dict.fromkeys(chain(*seen.values())))
    in_vain = {*waiting} if any(map(hides_effects, recordings)) else {*seen}  # to seek effects would take minutes
    if untold:
        reason = _together(seen_in_any) if seen_in_any else untold[0]
        raise _with_what_it_looks_like(reason, recordings, options)

    def result_of(channel: Channel) -> ChannelResult:
        found = _identified(channel, fitted[channel], data, options, misread=channel.name in in_vain)
        waiting.remove(channel.name)
        share = 1.0 - (1.0 - _SMOOTHED) * len(waiting) / len(channels)
        progress(f'fitting {", ".join(waiting)}' if waiting else 'done', share)
        return found

    results = {one.channel.name: one for one in together(result_of, fitted)}
    unidentified = {name: str(error) for name, error in failed.items()}
    notices = (*check_results(recordings, results, options, seen_in_any), *uneven)
    misread = any_warning([one for one in notices if one.code != 'size_suspect'])
    notices += tuple(_notice_of(one, misread) for one in failed.values())
    results = {name: one.doubted() if any_warning(notices) else one for name, one in results.items()}
    return Identification(
        tuple(recordings), data.recordings, data.splits, data.no_test, results, unidentified, options, notices
    )


def _without_waves(
    data: Prepared, fits: Mapping[str, Fit | InputError], channels: Sequence[Channel], options: Options
) -> tuple[Prepared, tuple[Notice, ...]]:
    """Return the recordings without waves of the displacement that no pressure follows, and what to say of them."""
    found = [ripple_of(*one) for one in zip(data.recordings, data.motions)]
    if not any(found):
        return data, ()
    recordings = tuple(one if waves is None else waves.without for one, waves in zip(data.recordings, found))
    even = prepare_recordings(recordings, options.fractions)
    pressures = [
        (waves, own, recorded, without)
        for channel in channels
        if channel.needed and isinstance(own := fits[channel.name], Fit)
        for index, recorded, without in zip(
            data.holding(channel), own.likelihood.experiments, even.experiments(channel)
        )
        if (waves := found[index])
    ]
    said = ripple_notice(pressures)
    return (data, ()) if said is None else (even, (said,))


def _steps(needed: Mapping[Channel, Fit | InputError], data: Prepared, options: Options) -> dict[str, list[Notice]]:
    """Return where set-points that were not recorded step, by the cylinders whose do."""
    found = {}
    for channel, one in needed.items():
        if isinstance(one, Fit):
            steps = steps_of_fit(one, data.recordings)
        else:
            steps = steps_of_pressure(channel, data.experiments(channel), data.recordings, options.ambient_pressure)
        found[channel.name] = list(steps)
    return {name: steps for name, steps in found.items() if steps}


def _together(notices: Sequence[Notice]) -> SuspectError:
    """Return notices of one kind, which have one mend, as an error."""
    return SuspectError(replace(notices[0], message='; '.join(one.message for one in notices)))


def _notice_of(error: InputError, doubted: bool) -> Notice:
    """Return why a channel could not be identified; of doubted data that is no suspicion of its own."""
    return error.notice if isinstance(error, SuspectError) and not doubted else note('not_identified', str(error))


def _with_what_it_looks_like(error: InputError, recordings: Sequence[Recording], options: Options) -> InputError:
    """Return the mistakes that recordings look like, and the error that they end in if nothing is mended."""
    seen = [one for one in check_recordings(recordings, options) if one.level == WARNING]
    if not seen:
        return error
    first, *others = seen
    last = str(error) if isinstance(error, SuspectError) else f'as it is read now, {error}'
    return SuspectError(replace(first, fix='; '.join([first.fix, *map(str, others), last])))


def _fitted(channel: Channel, data: Prepared) -> Fit | InputError:
    """Return a channel's model without effects, fitted, or why it could not be."""
    try:
        return fit_model(channel, data.experiments(channel))
    except SuspectError as error:
        return SuspectError(replace(error.notice, message=f'{channel.name}: {error.notice.message}'))
    except InputError as error:
        return InputError(f'{channel.name}: {error}')


def _identified(channel: Channel, joint: Fit, data: Prepared, options: Options, misread: bool) -> ChannelResult:
    """Return what a channel tells; in recordings that are misread nothing is searched for, which would take minutes."""
    held, experiments = data.holding(channel), joint.likelihood.experiments
    schedule, simulated, notes = _schedule(joint, options)
    found, conclusion = joint, None
    if options.close_loop:
        found, conclusion = close_loop(joint, options.core, not misread, options.tolerance)
    elif options.core == PHYSICAL:
        found = with_core(joint)
    return ChannelResult(
        channel=channel,
        fit=joint,
        schedule=tuple(schedule),
        comparisons=tuple(Comparison(channel, *one) for one in zip(held, experiments, simulated, found.simulated)),
        before=part_errors(experiments, simulated),
        after=part_errors(experiments, found.simulated),
        span=float(np.mean([one.span for one in experiments])),
        noise=joint.likelihood.noise(joint.model) if conclusion is None else conclusion.noise,
        notes=tuple(notes),
        found=found,
        conclusion=conclusion,
    )


def _schedule(joint: Fit, options: Options) -> tuple[list[OperatingPoint], list[Array], list[str]]:
    """Return the operating points, what they simulate, and what was left out."""
    levels = joint.likelihood.channel.levels(joint.likelihood.experiments, joint.model)
    if options.per_setpoint and levels:
        return _fit_each_setpoint(joint, levels, options.ambient_pressure)
    schedule = [OperatingPoint(float(np.mean(np.concatenate(levels))), joint)] if levels else []
    return schedule, list(joint.simulated), []


def _fit_each_setpoint(
    joint: Fit, levels: Sequence[Array], ambient_pressure: float
) -> tuple[list[OperatingPoint], list[Array], list[str]]:
    """
    Fit each set-point on its own; return the schedule, what it simulates, and what was left out.

    A recording that holds several set-points is simulated whole for each of them, and compared where it applies.
    """
    channel, experiments = joint.likelihood.channel, joint.likelihood.experiments
    simulated = [values.copy() for values in joint.simulated]
    schedule, notes = [], []
    for low, high in _bands(np.concatenate(levels), ambient_pressure):
        applies = [(low <= level) & (level <= high) for level in levels]
        used = [index for index, mask in enumerate(applies) if np.any(mask & experiments[index].counts)]
        if not used:
            notes.append(f'set-point {low:.0f} Pa left out of the schedule: only the test part holds it')
            continue
        setpoint = float(np.mean(np.concatenate([levels[index][applies[index]] for index in used])))
        try:
            chosen = [replace(experiments[index], index=rank) for rank, index in enumerate(used)]
            chosen = [replace(one, chosen=one.counts & applies[index]) for one, index in zip(chosen, used)]
            found = fit_model(channel, chosen)
        except InputError as error:
            notes.append(f'set-point {setpoint:.0f} Pa left out of the schedule: {error}')
            continue
        schedule.append(OperatingPoint(setpoint, found))
        for rank, index in enumerate(used):
            simulated[index][applies[index]] = found.simulated[rank][applies[index]]
    if not schedule:
        raise InputError('no set-point has data enough for a fit of its own: identify without --per-setpoint')
    return schedule, simulated, notes


def _bands(levels: Array, ambient_pressure: float) -> list[tuple[float, float]]:
    """Return lowest and highest level [Pa] of each group of neighbouring set-points, ascending."""
    values = np.unique(levels)
    gaps = np.flatnonzero(np.diff(values) > LARGEST_SETPOINT_GAP * (values[:-1] + ambient_pressure)) + 1
    return [(float(group[0]), float(group[-1])) for group in np.split(values, gaps)]
