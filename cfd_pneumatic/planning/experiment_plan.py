# SPDX-License-Identifier: Apache-2.0
"""Plan a schedule for a device within the limits of its cell, and predict its results."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

import numpy as np

from cfd_pneumatic.arguments import check_path, check_switches, check_type
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import PARTS
from cfd_pneumatic.model import CORES, EFFECTS, NAMES, SPECS, slowest
from cfd_pneumatic.planning.composition import LONGEST_ROUND, ROUNDS, Menu, compose
from cfd_pneumatic.planning.evidence import Evidence, evidence_of_samples
from cfd_pneumatic.planning.family import Segment, Turn, family
from cfd_pneumatic.planning.limits import Limits, Sensing
from cfd_pneumatic.planning.planned_device import device_at_home, home_gains, home_setpoints
from cfd_pneumatic.planning.prediction import EffectPrediction, ParameterPrediction, Planned
from cfd_pneumatic.planning.proposal import Drawing, Proposal
from cfd_pneumatic.planning.report import print_plan, write_plan
from cfd_pneumatic.planning.signatures import Form, all_signatures, split_of
from cfd_pneumatic.terminal import printed

WANTED = (*NAMES, *EFFECTS)
"""Names of all parameters and effects that a plan may target."""

MOST_SAMPLES = 400_000
"""Most samples of a schedule; their sensitivities take 1.3 GB and a minute."""

_ANY = 1e3  # visibility at the typical strength above which any strength counts as detectable
_SETTLED = 6.0  # time constants
_SHORTEST_REST, _LONGEST_REST = 0.3, 1.0  # the noise is estimated from rests of this length [s]


class Plan(Planned):
    """A schedule and its predicted results; prints as tables."""

    def save(self, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
        """
        Write `schedule.csv`, `plan.json` and `schedule.svg` into a folder, made if need be.

        Parameters
        ----------
        folder
            Output folder. An earlier plan is replaced.
        overwrite
            Whether to replace files of these names that this program did not write.

        Raises
        ------
        InputError
            If the folder cannot be written, or an existing file must not be replaced.

        """
        check_path('folder', folder)
        check_switches(overwrite=overwrite)
        return write_plan(self, Path(folder), overwrite=overwrite)

    def __str__(self) -> str:
        """Return the schedule and the predictions as tables."""
        return printed(lambda console: print_plan(self, console))


def plan(device: Device, limits: Limits, sensing: Sensing = Sensing(), wanted: Collection[str] = WANTED) -> Plan:
    """
    Return the schedule with the most information about the wanted names within the limits of a cell.

    Raises
    ------
    InputError
        If a wanted name is unknown, or if no stroke or too many samples fit within the limits.

    """
    check_type('device', device, Device, 'a device')
    check_type('limits', limits, Limits, 'Limits')
    check_type('sensing', sensing, Sensing, 'Sensing')
    check_type('wanted', wanted, Collection, 'a list of parameters and effects')
    for name in wanted:
        if name not in WANTED:
            raise InputError(f'{name} is neither a parameter nor an effect: wanted may be {", ".join(WANTED)}')
    if limits.duration > MOST_SAMPLES * sensing.period:
        raise InputError(
            f'duration {limits.duration:g} s at a sample rate of {sensing.sample_rate:g} Hz is more than '
            f'{MOST_SAMPLES:,} samples: give a shorter duration, or plan with a lower sample rate'
        )
    device = device_at_home(device, limits.pressures)
    drawing = Drawing(limits, sensing, home_setpoints(device), settling(device))
    offered = _distinct_segments(device, limits)
    menu = Menu.from_signatures(offered, drawing, all_signatures(drawing.draw(offered), device, sensing))
    samples = int(limits.duration / sensing.period + 1e-9) - drawing.opening
    for rounds in (max(ROUNDS, math.ceil(limits.duration / LONGEST_ROUND)), 1):
        segments = compose(menu, samples // rounds, rounds, wanted)
        if segments:
            proposal = drawing.draw(segments * rounds)
            return Plan(proposal, segments, rounds, *predict(proposal, device, sensing, wanted))
    shortest = (drawing.opening + min(menu.lengths)) * sensing.period
    raise InputError(f'duration {limits.duration:g} s is too short for a stroke: give {shortest:.1f} s or more')


def settling(device: Device) -> float:
    """Return the time in which the pressures settle [s]."""
    longest = max(slowest(home_gains(device, name)) for name in device.model.cylinders)
    return min(max(_SETTLED * longest, _SHORTEST_REST), _LONGEST_REST)


def _distinct_segments(device: Device, limits: Limits) -> list[Segment]:
    """Return the segments that differ for this device and cell; of equal segments the simpler."""
    low, high = limits.pressures
    seen: dict[tuple[object, ...], Segment] = {}
    for segment in family():
        if segment.turns and low == high:
            continue
        shares = [
            tuple(getattr(step, name) for name in device.model.cylinders) if isinstance(step, Turn) else step
            for step in segment.steps
        ]
        turned = [share for share, step in zip(shares, segment.steps) if isinstance(step, Turn)]
        if turned and not any(any(share) for share in turned):
            continue  # only the set-point of a missing cylinder would change
        seen.setdefault(tuple(shares), segment)
    return list(seen.values())


def predict(
    proposal: Proposal, device: Device, sensing: Sensing, wanted: Collection[str]
) -> tuple[tuple[ParameterPrediction, ...], tuple[EffectPrediction, ...]]:
    """
    Predict the results of a recording of a proposal.

    As in `identify_bag`, parameters are fitted to train and validation, and effects are searched in train.
    """
    signatures = all_signatures(proposal, device, sensing)
    part = split_of(proposal, sensing).part_of(proposal.times)
    fitted = evidence_of_samples(signatures, part < PARTS.index('test'))
    searched = evidence_of_samples(signatures, part == PARTS.index('train'))
    parameters = [prediction for evidence in fitted for prediction in _predict_parameters(evidence, wanted)]
    effects = [prediction for evidence in searched for prediction in _predict_effects(evidence, wanted)]
    return tuple(parameters), tuple(effects)


def _predict_parameters(evidence: Evidence, wanted: Collection[str]) -> list[ParameterPrediction]:
    units = {spec.name: spec.unit for spec in SPECS} | {'area': 'm^2'}
    units |= {
        f'{name}.{parameter.name}': parameter.unit
        for name, effect in {**CORES, **EFFECTS}.items()
        for parameter in effect.parameters
    }
    return [
        ParameterPrediction(
            evidence.signatures.channel, name, units[name], value, float(std * abs(value)) if np.isfinite(std) else None
        )
        for name, value, std in zip(evidence.signatures.fitted, evidence.signatures.values.tolist(), evidence.stds)
        if name in wanted or (name in units and name not in NAMES)  # the band of a curve has its heights
    ]


def _predict_effects(evidence: Evidence, wanted: Collection[str]) -> list[EffectPrediction]:
    predictions = []
    for name in evidence.effects:
        if name not in wanted:
            continue
        visibility = evidence.visibility[name]
        least = int(np.argmin(visibility))
        remaining = {rival: float(shares.min()) for rival, shares in evidence.remaining[name].items()}
        nearest = min(remaining, key=lambda rival: remaining[rival], default=None)
        distinctness = evidence.distinctness(name).items()
        alike = [rival for rival, preferences in distinctness if float(preferences.min()) < 1.0]
        predictions.append(
            EffectPrediction(
                evidence.signatures.channel,
                name,
                bool(visibility[least] > 1.0),
                _smallest_strength(
                    evidence.signatures.forms[evidence.basic_forms[name][least]], float(visibility[least])
                ),
                tuple(sorted(alike, key=lambda rival: remaining[rival])),
                None if nearest is None else (nearest, remaining[nearest]),
            )
        )
    channel = evidence.signatures.channel
    hidden = [name for name in evidence.signatures.unidentifiable if name in wanted]
    return predictions + [EffectPrediction(channel, name, False, None, (), None) for name in hidden]


def _smallest_strength(form: Form, visibility: float) -> dict[str, float] | None:
    """Return the strength at which a form is just detectable, with its choices, by name of the parameter."""
    if visibility <= 0.0:
        return None
    if visibility > _ANY:
        return {}
    effect = EFFECTS[form.effect]
    chosen = effect.parameters[effect.strengths[0]].choice
    parameters = form.typical if chosen else effect.of_strength(form.typical, 1.0 / visibility)
    return {
        parameter.name: value
        for index, (parameter, value) in enumerate(zip(effect.parameters, parameters))
        if value != parameter.null and (index in effect.strengths or parameter.choice)
    }
