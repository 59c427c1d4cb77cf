# SPDX-License-Identifier: Apache-2.0
"""Identify a device from recordings: smooth, split, fit, check and close the loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.changes import Change, Cut, Drift
from cfd_pneumatic.identification.channels import Channel, channels_of
from cfd_pneumatic.identification.conclusion import part_errors
from cfd_pneumatic.identification.data import PHYSICAL, Options
from cfd_pneumatic.identification.device_changes import (
    cuts_of,
    cuts_of_curves,
    drifts_of,
    state_of,
    straight_drifts_of,
    without_drifts,
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
from cfd_pneumatic.identification.operating_points import schedule_of
from cfd_pneumatic.identification.preparation import Prepared, prepare_recordings
from cfd_pneumatic.identification.progress import SMOOTHING_SHARE, Progress, SearchProgress, effort_of
from cfd_pneumatic.identification.result import ChannelResult, Comparison, Identification
from cfd_pneumatic.identification.search import with_core
from cfd_pneumatic.identification.thresholds import MOST_SAMPLES_TOGETHER
from cfd_pneumatic.notices import WARNING, Notice, SuspectError, any_warning, note
from cfd_pneumatic.recording import Recording, split_at_gaps
from cfd_pneumatic.runtime import map_in_threads

_DRIFT_CAUSES = 'inspect the temperature of sensor, regulator and supply. The drift is no change of the device'
_DRIFT_REMOVED = f'{_DRIFT_CAUSES}. It was removed before the fit'
_DRIFT_IN_MODEL = f'{_DRIFT_CAUSES}. It is part of the model'
_AFTER_CHANGE = (
    'inspect what happened then. The results are those after the change; the card of the change and report.json have '
    'those before'
)


def identify(
    recordings: Sequence[Recording],
    options: Options = Options(),
    progress: Progress = lambda _what, _share: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> Identification:
    """
    Identify each recorded channel, jointly over all recordings.

    A failure of the force does not prevent the identification of the cylinders. Each piece of a recording between gaps
    is a separate recording. If the device changed during a recording, the parts before and after the change are
    identified separately.

    Parameters
    ----------
    recordings, options
        Recordings of one device, and how to identify them.
    progress
        See `Progress`.
    is_stopped
        Returns whether the search for effects has to end with the best answer so far.

    Raises
    ------
    InputError
        If there is no recording, a recording has no motion or too few samples, or a cylinder has no identifiable
        parameter.

    """
    if not recordings:
        raise InputError('there is no recording to identify: give one or more')
    pieces = [piece for recording in recordings for piece in split_at_gaps(recording)]
    return _identify_pieces(pieces, options, progress, is_stopped)


def _identify_pieces(
    recordings: Sequence[Recording],
    options: Options,
    progress: Progress,
    is_stopped: Callable[[], bool],
    may_change: bool = True,
) -> Identification:
    """
    Identify recordings without gaps.

    `may_change` is False for the parts before and after a change.
    """
    progress('smoothing the displacement', 0.0)
    try:
        data = prepare_recordings(recordings, options.fractions)
    except InputError as error:
        raise _with_input_warnings(error, recordings, options) from error
    channels = channels_of(recordings, options)
    waiting = [channel.name for channel in channels]
    progress(f'fitting {", ".join(waiting)}', SMOOTHING_SHARE)

    samples = sum(len(recording.displacement.times) for recording in recordings)
    map_channels = map_in_threads if samples <= MOST_SAMPLES_TOGETHER else map  # threads need more memory
    fits = dict(zip(waiting, map_channels(lambda channel: _fit_channel(channel, data), channels)))
    without_ripple, ripple_notices = _remove_ripple(data, fits, channels, options)
    if ripple_notices:
        data = without_ripple
        fits = dict(zip(waiting, map_channels(lambda channel: _fit_channel(channel, data), channels)))
    failed = {name: fit for name, fit in fits.items() if isinstance(fit, InputError)}
    fitted = {channel: fit for channel in channels if isinstance(fit := fits[channel.name], Fit)}
    needed = {channel: fits[channel.name] for channel in channels if channel.needed}
    errors = [fit for fit in needed.values() if isinstance(fit, InputError)]
    is_implausible = bool(errors) or is_misread([fit for fit in needed.values() if isinstance(fit, Fit)])
    reading = alternative_reading(recordings, options) if is_implausible else None
    notices_by_channel = {name: [reading] for name in waiting} if reading else _check_steps(needed, data, options)
    fit_notices = list(dict.fromkeys(chain(*notices_by_channel.values())))
    drifts: list[tuple[int, Drift]] = []
    is_tested = (options.close_loop or bool(errors)) and not (reading or fit_notices)
    is_tested = is_tested and not any_warning(check_recordings(recordings, options))
    cuts: dict[tuple[str, int], Cut] = {}
    if is_tested and may_change:
        cuts = {(channel.name, index): cut for channel in needed for index, cut in cuts_of(channel, data)}
        changed = _identify_parts(recordings, cuts, options, progress, is_stopped) if errors else None
        if changed is not None:
            return changed
    if is_tested and not (errors or cuts):
        drifts = [drift for channel in needed for drift in drifts_of(channel, data)]
        if drifts:
            data = replace(data, recordings=without_drifts(data, drifts))
            fits |= {channel.name: _fit_channel(channel, data) for channel in channels}
            failed = {name: fit for name, fit in fits.items() if isinstance(fit, InputError)}
            fitted = {channel: fit for channel in channels if isinstance(fit := fits[channel.name], Fit)}
    # A search for effects in these channels would take minutes and find nothing.
    not_searched = {*waiting} if any(map(hides_effects, recordings)) else {*notices_by_channel}
    if errors:
        reason = _combine(fit_notices) if fit_notices else errors[0]
        raise _with_input_warnings(reason, recordings, options)

    shown = SearchProgress(_share_of(progress, 0.0, 1.0 / 3.0) if cuts else progress, len(channels))

    def result_of(channel: Channel) -> ChannelResult:
        fit = fitted[channel]
        effort = effort_of(fit, options, is_stopped, partial(shown.show, channel.name))
        fit = replace(fit, likelihood=replace(fit.likelihood, effort=effort))
        result = _identify_channel(channel, fit, data, options, misread=channel.name in not_searched)
        shown.end(channel.name)
        return result

    results = {result.channel.name: result for result in map_channels(result_of, fitted)}
    if is_tested and may_change:
        # a model that explains the whole recording needs no change
        cuts = {key: cut for key, cut in cuts.items() if not _is_explained(results[key[0]])}
        cuts |= dict(cuts_of_curves(results))
        rest = _share_of(progress, 1.0 / 3.0, 1.0)
        changed = _identify_parts(recordings, cuts, options, rest, is_stopped)
        if changed is not None:
            return changed
    progress('done', 1.0)
    unidentified = {name: str(error) for name, error in failed.items()}
    notices = (*check_results(recordings, results, options, fit_notices), *ripple_notices)
    straight_drifts = [*straight_drifts_of(results)]
    notices += tuple(note('slow_drift', drift.text, _DRIFT_REMOVED) for _, drift in drifts)
    notices += tuple(note('slow_drift', drift.text, _DRIFT_IN_MODEL) for drift in straight_drifts)
    misread = any_warning([notice for notice in notices if notice.code != 'size_suspect'])
    notices += tuple(_notice_of(error, misread) for error in failed.values())
    results = {name: result.doubted() if any_warning(notices) else result for name, result in results.items()}
    return Identification(
        tuple(recordings),
        data.recordings,
        data.splits,
        data.no_test,
        results,
        unidentified,
        options,
        notices,
        is_interrupted=is_stopped(),
        drifts=(*(drift for _, drift in drifts), *straight_drifts),
    )


def _identify_parts(
    recordings: Sequence[Recording],
    cuts: Mapping[tuple[str, int], Cut],
    options: Options,
    progress: Progress,
    is_stopped: Callable[[], bool],
) -> Identification | None:
    """
    Identify the recordings before and after a change of the device; return None if the device did not change.

    `cuts` has the changes by name of the channel and index of the recording; the clearest change counts. The change
    also has to leave two parts that can be identified without a warning. Otherwise a likely input error, and not a
    change, may explain the error.
    """
    if not cuts:
        return None
    main = max(cuts, key=lambda key: cuts[key].drop)
    index, cut = main[1], cuts[main]
    recording = recordings[index]
    parts = (
        [*recordings[:index], recording.between(float(recording.displacement.times[0]), cut.low)],
        [recording.between(cut.high, math.inf), *recordings[index + 1 :]],
    )
    quick = replace(options, close_loop=False)
    try:
        if any(
            any_warning(_identify_pieces(part, quick, lambda _what, _share: None, is_stopped, may_change=False).notices)
            for part in parts
        ):
            return None
        before, after = (
            _identify_pieces(
                part, options, _share_of(progress, 0.5 * half, 0.5 * (half + 1)), is_stopped, may_change=False
            )
            for half, part in enumerate(parts)
        )
    except InputError:
        return None
    changes = tuple(
        Change(
            name,
            recording.name,
            cut.time,
            (cut.low, cut.high),
            state_of(before.channels[name], before.channels[name].comparisons[-1]),
            state_of(after.channels[name], after.channels[name].comparisons[0]),
        )
        for (name, place), found in cuts.items()
        if place == index and found.low <= cut.high and cut.low <= found.high
    )
    notices = tuple(note('changed_during_recording', change.text, _AFTER_CHANGE) for change in changes)
    return replace(after, notices=(*notices, *after.notices), changes=changes)


def _share_of(progress: Progress, begin: float, end: float) -> Progress:
    """Return a function that reports the progress of a part of the work, between two shares of the whole."""
    return lambda what, share: progress(what, begin + (end - begin) * share)


def _is_explained(result: ChannelResult) -> bool:
    return result.conclusion is not None and result.conclusion.explained_to_within is not None


def _remove_ripple(
    data: Prepared, fits: Mapping[str, Fit | InputError], channels: Sequence[Channel], options: Options
) -> tuple[Prepared, tuple[Notice, ...]]:
    """Return the recordings without sensor ripple, and a note; the recordings as they are without ripple."""
    ripples = [ripple_of(*recorded) for recorded in zip(data.recordings, data.motions)]
    if not any(ripples):
        return data, ()
    recordings = tuple(
        recording if ripple is None else ripple.without for recording, ripple in zip(data.recordings, ripples)
    )
    even = prepare_recordings(recordings, options.fractions)
    pressures = [
        (ripple, fit, recorded, without)
        for channel in channels
        if channel.needed and isinstance(fit := fits[channel.name], Fit)
        for index, recorded, without in zip(
            data.holding(channel), fit.likelihood.experiments, even.experiments(channel)
        )
        if (ripple := ripples[index])
    ]
    notice = ripple_notice(pressures)
    return (data, ()) if notice is None else (even, (notice,))


def _check_steps(
    needed: Mapping[Channel, Fit | InputError], data: Prepared, options: Options
) -> dict[str, list[Notice]]:
    """Return warnings about steps of set-points that were not recorded, by cylinder."""
    notices = {}
    for channel, fit in needed.items():
        if isinstance(fit, Fit):
            steps = steps_of_fit(fit, data.recordings)
        else:
            steps = steps_of_pressure(channel, data.experiments(channel), data.recordings, options.ambient_pressure)
        notices[channel.name] = list(steps)
    return {name: steps for name, steps in notices.items() if steps}


def _combine(notices: Sequence[Notice]) -> SuspectError:
    """Return notices of the same kind and fix as an error."""
    return SuspectError(replace(notices[0], message='; '.join(notice.message for notice in notices)))


def _notice_of(error: InputError, misread: bool) -> Notice:
    """Return why a channel could not be identified, as a warning only if no other warning explains the failure."""
    return error.notice if isinstance(error, SuspectError) and not misread else note('not_identified', str(error))


def _with_input_warnings(error: InputError, recordings: Sequence[Recording], options: Options) -> InputError:
    """Return an error that begins with the warnings about likely input errors."""
    warnings = [notice for notice in check_recordings(recordings, options) if notice.level == WARNING]
    if not warnings:
        return error
    first, *following = warnings
    last = str(error) if isinstance(error, SuspectError) else f'otherwise, {error}'
    return SuspectError(replace(first, fix='; '.join([first.fix, *map(str, following), last])))


def _fit_channel(channel: Channel, data: Prepared) -> Fit | InputError:
    """Return the fit of a channel's model without effects, or the error that prevents the fit."""
    try:
        return fit_model(channel, data.experiments(channel))
    except SuspectError as error:
        return SuspectError(replace(error.notice, message=f'{channel.name}: {error.notice.message}'))
    except InputError as error:
        return InputError(f'{channel.name}: {error}')


def _identify_channel(channel: Channel, joint: Fit, data: Prepared, options: Options, misread: bool) -> ChannelResult:
    """Return the result of a channel, without a search for effects if the recordings are misread."""
    indices, experiments = data.holding(channel), joint.likelihood.experiments
    schedule, simulated, notes = schedule_of(joint, options)
    found, conclusion = joint, None
    if options.close_loop:
        found, conclusion = close_loop(joint, options.core, not misread, options.tolerance)
    elif options.core == PHYSICAL:
        found = with_core(joint)
    return ChannelResult(
        channel=channel,
        fit=joint,
        schedule=tuple(schedule),
        comparisons=tuple(
            Comparison(channel, *compared) for compared in zip(indices, experiments, simulated, found.simulated)
        ),
        before=part_errors(experiments, simulated),
        after=part_errors(experiments, found.simulated),
        span=float(np.mean([experiment.span for experiment in experiments])),
        noise=joint.likelihood.noise(joint.model) if conclusion is None else conclusion.noise,
        notes=tuple(notes),
        found=found,
        conclusion=conclusion,
    )
