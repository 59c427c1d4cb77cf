# SPDX-License-Identifier: Apache-2.0
"""
What parameters and effects do to a recording that a proposal would give: their signatures.

Everything that is asked of a proposal follows from the scalar products of signatures. Products of stretches that rest
at both ends add up, so that what a schedule tells is the sum of what its segments tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device
from cfd_pneumatic.identification import (
    SHOWN,
    STRENGTH,
    Channel,
    Complement,
    Experiment,
    Force,
    Likelihood,
    Model,
    Motion,
    Pressure,
    Split,
    split_recordings,
    stroke_times,
)
from cfd_pneumatic.model import DIRECTIONS, Effect
from cfd_pneumatic.planning.limits import Sensing
from cfd_pneumatic.planning.planned_device import home_gains
from cfd_pneumatic.planning.proposal import Proposal
from cfd_pneumatic.runtime import map_in_threads

_ATTEMPTS = 8
_NEARLY = 1.2  # times as large, or as small
_VARIED = 2.0  # times


@dataclass(frozen=True)
class Form:
    """
    One form that an effect may have.

    Attributes
    ----------
    effect
        Its name.
    typical
        Parameters at its typical strength: where the search for effects would start.
    share
        Of the typical strength at which its signature is taken: where it just shows, or all of it.
    varied
        Whether it is another one with one parameter changed: nobody asks whether that shows, but a fit may end there.

    """

    effect: str
    typical: tuple[float, ...]
    share: float
    varied: bool = False


@dataclass(frozen=True)
class Signatures:
    """
    Of one channel: a cylinder's pressure, or the force.

    Attributes
    ----------
    channel
        `cylinder_a`, `cylinder_b` or `force`.
    noise
        Standard deviation of a sample [Pa or N].
    own
        Names of what is fitted anyway: parameters, effects' as `EFFECT.PARAMETER`, otherwise empty.
    values
        Of these, where they have a name; standard errors are shares of them.
    forms
        Of effects that may be missing.
    unidentifiable
        Effects that may be missing and never are, whatever they are like: the motion is too quick for the samples.
    columns
        By what is fitted anyway, then the change that each form makes, shape (n, own + forms) [Pa or N].

    """

    channel: str
    noise: float
    own: tuple[str, ...]
    values: Array
    forms: tuple[Form, ...]
    unidentifiable: tuple[str, ...]
    columns: Array

    def products(self, samples: slice | NDArray[np.bool_] = slice(None)) -> Array:
        """Return the scalar products of all columns over some samples, in units of the noise."""
        chosen = self.columns[samples] / self.noise
        return np.asarray(chosen.T @ chosen)


@dataclass(frozen=True)
class Planned:
    """A channel in the recording that a proposal would give, without noise, and the model that makes it."""

    experiment: Experiment
    complement: Complement
    noise: float


def all_signatures(proposal: Proposal, device: Device, sensing: Sensing) -> list[Signatures]:
    """Return the signatures of each channel of a device."""
    return [_signatures(one) for one in planned(proposal, device, sensing)]


def planned(proposal: Proposal, device: Device, sensing: Sensing) -> list[Planned]:
    """Return each channel of a device in the recording that a proposal would give: the cylinders, then the force."""
    found = []
    geometry, ambient_pressure = device.model.geometry, device.model.geometry.ambient_pressure
    absent = np.full(proposal.times.size, ambient_pressure)
    pressures, levels = dict.fromkeys(CYLINDERS, absent), dict.fromkeys(CYLINDERS, absent)
    for name, cylinder in device.model.cylinders.items():
        levels[name] = proposal.setpoints[:, CYLINDERS.index(name)] + ambient_pressure
        inputs = {'displacement': DIRECTIONS[name] * proposal.displacement, 'setpoint': levels[name]}
        channel = Pressure(name, ambient_pressure)
        model = Model.of_parts(
            home_gains(device, name), cylinder.effects, np.zeros((1, len(channel.recording_parameters)))
        )
        found.append(_planned(proposal, channel, model, inputs, sensing, sensing.pressure_noise))
        pressures[name] = found[-1].experiment.measured
    inputs = {
        'displacement': proposal.displacement,
        'rate': proposal.velocity,
        'acceleration': proposal.acceleration,
        'pressure': pressures['cylinder_a'],
        'opposing': pressures['cylinder_b'],
        'level': levels['cylinder_a'] - levels['cylinder_b'],
    }
    force = Force(geometry.area, geometry.geometric_factor, ambient_pressure)
    parameters = np.array([geometry.area, geometry.geometric_factor])
    model = Model(parameters, device.model.force_effects, np.zeros((1, 1)))
    return [*found, _planned(proposal, force, model, inputs, sensing, sensing.force_noise)]


def _planned(
    proposal: Proposal, channel: Channel, model: Model, inputs: Mapping[str, Array], sensing: Sensing, noise: float
) -> Planned:
    experiment = Experiment(
        recording='proposal',
        times=proposal.times,
        inputs=inputs,
        samples=np.arange(proposal.times.size),
        measured=proposal.times,
        part=split_of(proposal, sensing).part_of(proposal.times),
        motion=_motion_of(proposal, sensing),
        starts_at_rest=True,
        chosen=np.ones(proposal.times.size, dtype=np.bool_),
    )
    experiment = replace(experiment, measured=channel.simulated([experiment], model)[0])
    blurred = channel.sensitivity(model) * sensing.displacement_noise  # at its worst
    likelihood = Likelihood.alike(channel, [experiment])
    return Planned(experiment, Complement(likelihood, model), float(np.hypot(noise, blurred)))


def split_of(proposal: Proposal, sensing: Sensing) -> Split:
    """Return where `identify_bag` will cut the recording."""
    (split,), _ = split_recordings([stroke_times(proposal.times, proposal.displacement, sensing.displacement_noise)])
    return split


def _motion_of(proposal: Proposal, sensing: Sensing) -> Motion:
    """Return the motion as the smoother would have it at best."""
    return Motion(
        times=proposal.times,
        displacement=proposal.displacement,
        rate=proposal.velocity,
        acceleration=proposal.acceleration,
        reach=float(np.ptp(proposal.displacement)),
        noise=sensing.displacement_noise,
        uncertainty=sensing.displacement_noise,
        rate_uncertainty=0.0,
        order=2,
        deviance=0.0,
        stamps=proposal.times,
    )


def _signatures(one: Planned) -> Signatures:
    complement, model = one.complement, one.complement.model
    channel = complement.likelihood.channel
    strength = STRENGTH * one.noise
    known = channel.data([one.experiment], model, [one.experiment.measured])
    data = {**known, 'residual': strength, 'mean': strength, 'lag': 0.0}
    missing = channel.candidates(model)
    hidden = tuple(effect for effect in missing if channel.unidentifiable([one.experiment], effect) is not None)
    visible = {effect: channel.effects[effect] for effect in missing if effect not in hidden}
    forms, columns = _formed(visible, data, one.noise, complement)
    unknowns = channel.unknowns([one.experiment], model)
    values = channel.row(model)[[unknown.slot for unknown in unknowns]]
    names = tuple(unknown.name for unknown in unknowns)
    return Signatures(
        channel.name, one.noise, names, values, forms, hidden, np.column_stack([complement.jacobian, *columns])
    )


def _formed(
    library: Mapping[str, Effect], data: Mapping[str, float], noise: float, complement: Complement
) -> tuple[tuple[Form, ...], list[Array]]:
    """Return the forms of effects and their signatures, each where it just shows beside what is fitted anyway."""

    def visibility(columns: Array) -> Array:
        return np.asarray(np.sqrt(np.mean(complement.remainder(columns) ** 2, axis=0)) / (SHOWN * noise))

    def of_effect(name: str) -> tuple[list[Form], Array]:
        effect = library[name]
        typical = [one for one in effect.starts(data) if effect.of_strength(one, 0.5) != one]  # without strength: none
        shares, columns = _just_showing(typical, effect, lambda ones: complement.changes(name, ones), visibility)
        forms = [Form(name, one, share) for one, share in zip(typical, shares.tolist())]
        varied = [replace(form, typical=other, varied=True) for form in forms for other in _varied(form, effect)]
        if not varied:
            return forms, columns
        more = complement.changes(name, [effect.of_strength(form.typical, form.share) for form in varied])
        return [*forms, *varied], np.column_stack([columns, np.where(np.isfinite(more), more, 0.0)])

    complement.remainder(complement.simulated)  # made once, before threads ask for it
    found = map_in_threads(of_effect, list(library))
    return tuple(form for forms, _ in found for form in forms), [columns for _, columns in found]


def _varied(form: Form, effect: Effect) -> list[tuple[float, ...]]:
    """Return a form's parameters with each of those changed that a fit searches and that is not its strength."""
    others = []
    for index, (parameter, value) in enumerate(zip(effect.parameters, form.typical)):
        if not parameter.choice and value and index not in effect.strengths:
            changed = _VARIED * value if parameter.lower <= _VARIED * value <= parameter.upper else value / _VARIED
            others.append((*form.typical[:index], changed, *form.typical[index + 1 :]))
    return others


def _just_showing(
    typical: Sequence[tuple[float, ...]],
    effect: Effect,
    changes: Callable[[Sequence[tuple[float, ...]]], Array],
    visibility: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """
    Return at about which share of its strength each form just shows, and what it changes there.

    A form that does not show at its typical strength is left at that. Most changes are in proportion to the strength,
    so that the first guess will do; a limit that does not bind any more changes nothing at all.
    """
    shares, least, most = np.ones(len(typical)), np.zeros(len(typical)), np.ones(len(typical))
    for attempt in range(_ATTEMPTS):
        columns = changes([effect.of_strength(one, share) for one, share in zip(typical, shares.tolist())])
        sizes = np.nan_to_num(visibility(columns), nan=np.inf)
        large, small = sizes > _NEARLY, (sizes < 1.0 / _NEARLY) & (shares < 1.0)
        if attempt == _ATTEMPTS - 1 or not np.any(large | small):
            break
        most[large], least[small] = shares[large], shares[small]
        middle = np.sqrt(np.maximum(least, 0.01 * most) * most)
        guess = shares / np.clip(sizes, 1e-3, 1e3)
        shares = np.where(large | small, np.where((least < guess) & (guess < most), guess, middle), shares)
    return shares, np.where(np.isfinite(columns), columns, 0.0)
