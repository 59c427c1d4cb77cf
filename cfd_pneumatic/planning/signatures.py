# SPDX-License-Identifier: Apache-2.0
"""
Compute the signatures of parameters and effects: their influence on the recording of a proposal.

The scalar products of signatures determine all predictions. Products of segments that begin and end at rest add up, so
that the information of a schedule is the sum over its segments.
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
_TOLERANCE = 1.2  # times as large, or as small
_VARIATION = 2.0  # times


@dataclass(frozen=True)
class Form:
    """
    A form of an effect.

    Attributes
    ----------
    effect
        Name of the effect.
    typical
        Parameters at the typical strength, from which the search for effects starts.
    share
        Share of the typical strength at which the signature is taken: just detectable, or at most 1.
    varied
        Whether the form is a variation with a changed parameter. A fit may end in a variation, but its visibility does
        not matter.

    """

    effect: str
    typical: tuple[float, ...]
    share: float
    varied: bool = False


@dataclass(frozen=True)
class Signatures:
    """
    Signatures of a channel: the pressure of a cylinder, or the force.

    Attributes
    ----------
    channel
        `cylinder_a`, `cylinder_b` or `force`.
    noise
        Standard deviation of a sample [Pa or N].
    fitted
        Names of the fitted parameters, of effects as `EFFECT.PARAMETER`; empty for nuisance parameters.
    values
        Values of the named parameters; standard errors are relative to the values.
    forms
        Forms of effects that the model may lack.
    unidentifiable
        Effects that this motion cannot show, because the motion is too quick for the sampling.
    columns
        Derivatives by the fitted parameters, then the change of each form, shape (n, fitted + forms) [Pa or N].

    """

    channel: str
    noise: float
    fitted: tuple[str, ...]
    values: Array
    forms: tuple[Form, ...]
    unidentifiable: tuple[str, ...]
    columns: Array

    def products(self, samples: slice | NDArray[np.bool_] = slice(None)) -> Array:
        """Return the scalar products of all columns over selected samples, in units of the noise."""
        chosen = self.columns[samples] / self.noise
        return np.asarray(chosen.T @ chosen)


@dataclass(frozen=True)
class Planned:
    """A channel in the noise-free recording of a proposal, and its model."""

    experiment: Experiment
    complement: Complement
    noise: float


def all_signatures(proposal: Proposal, device: Device, sensing: Sensing) -> list[Signatures]:
    """Return the signatures of each channel of a device."""
    return [_signatures(channel) for channel in planned(proposal, device, sensing)]


def planned(proposal: Proposal, device: Device, sensing: Sensing) -> list[Planned]:
    """Return each channel of a device in the recording of a proposal: the cylinders, then the force."""
    channels = []
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
        channels.append(_planned(proposal, channel, model, inputs, sensing, sensing.pressure_noise))
        pressures[name] = channels[-1].experiment.measured
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
    return [*channels, _planned(proposal, force, model, inputs, sensing, sensing.force_noise)]


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
    displacement_error = channel.sensitivity(model) * sensing.displacement_noise  # at its worst
    likelihood = Likelihood.alike(channel, [experiment])
    return Planned(experiment, Complement(likelihood, model), float(np.hypot(noise, displacement_error)))


def split_of(proposal: Proposal, sensing: Sensing) -> Split:
    """Return the split of the recording into parts by `identify_bag`."""
    (split,), _ = split_recordings([stroke_times(proposal.times, proposal.displacement, sensing.displacement_noise)])
    return split


def _motion_of(proposal: Proposal, sensing: Sensing) -> Motion:
    """Return the motion that a perfect smoother would give."""
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


def _signatures(planned_channel: Planned) -> Signatures:
    complement, model = planned_channel.complement, planned_channel.complement.model
    channel = complement.likelihood.channel
    strength = STRENGTH * planned_channel.noise
    known = channel.data([planned_channel.experiment], model, [planned_channel.experiment.measured])
    data = {**known, 'residual': strength, 'mean': strength, 'lag': 0.0, 'setpoint_lag': 0.0}
    missing = channel.candidates(model)
    hidden = tuple(
        effect for effect in missing if channel.unidentifiable([planned_channel.experiment], effect) is not None
    )
    visible = {effect: channel.effects[effect] for effect in missing if effect not in hidden}
    forms, columns = _forms_and_columns(visible, data, planned_channel.noise, complement)
    unknowns = channel.unknowns([planned_channel.experiment], model)
    values = channel.row(model)[[unknown.slot for unknown in unknowns]]
    names = tuple(unknown.name for unknown in unknowns)
    return Signatures(
        channel.name,
        planned_channel.noise,
        names,
        values,
        forms,
        hidden,
        np.column_stack([complement.jacobian, *columns]),
    )


def _forms_and_columns(
    library: Mapping[str, Effect], data: Mapping[str, float], noise: float, complement: Complement
) -> tuple[tuple[Form, ...], list[Array]]:
    """Return the forms of effects and their signatures, just detectable next to the fitted parameters."""

    def visibility(columns: Array) -> Array:
        return np.asarray(np.sqrt(np.mean(complement.remainder(columns) ** 2, axis=0)) / (SHOWN * noise))

    def forms_of_effect(name: str) -> tuple[list[Form], Array]:
        effect = library[name]
        starts = effect.starts(data)
        typical = [values for values in starts if effect.of_strength(values, 0.5) != values]  # with a strength
        shares, columns = _scale_to_detectable(
            typical, effect, lambda parameters: complement.changes(name, parameters), visibility
        )
        forms = [Form(name, values, share) for values, share in zip(typical, shares.tolist())]
        varied = [replace(form, typical=values, varied=True) for form in forms for values in _varied(form, effect)]
        if not varied:
            return forms, columns
        varied_columns = complement.changes(name, [effect.of_strength(form.typical, form.share) for form in varied])
        return [*forms, *varied], np.column_stack([columns, np.where(np.isfinite(varied_columns), varied_columns, 0.0)])

    complement.remainder(complement.simulated)  # fills the cache before the threads use it
    results = map_in_threads(forms_of_effect, list(library))
    return tuple(form for forms, _ in results for form in forms), [columns for _, columns in results]


def _varied(form: Form, effect: Effect) -> list[tuple[float, ...]]:
    """Return variations of a form's parameters: each changes a searched parameter other than the strength."""
    variations = []
    for index, (parameter, value) in enumerate(zip(effect.parameters, form.typical)):
        if not parameter.choice and value and index not in effect.strengths:
            changed = (
                _VARIATION * value if parameter.lower <= _VARIATION * value <= parameter.upper else value / _VARIATION
            )
            variations.append((*form.typical[:index], changed, *form.typical[index + 1 :]))
    return variations


def _scale_to_detectable(
    typical: Sequence[tuple[float, ...]],
    effect: Effect,
    changes: Callable[[Sequence[tuple[float, ...]]], Array],
    visibility: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """
    Return the share of the strength at which each form is just detectable, about, and its change there.

    A form that is not detectable at its typical strength keeps that strength. Most changes are proportional to the
    strength, so that the first guess suffices. A limit that does not act changes nothing.
    """
    shares, least, most = np.ones(len(typical)), np.zeros(len(typical)), np.ones(len(typical))
    for attempt in range(_ATTEMPTS):
        columns = changes([effect.of_strength(values, share) for values, share in zip(typical, shares.tolist())])
        sizes = np.nan_to_num(visibility(columns), nan=np.inf)
        large, small = sizes > _TOLERANCE, (sizes < 1.0 / _TOLERANCE) & (shares < 1.0)
        if attempt == _ATTEMPTS - 1 or not np.any(large | small):
            break
        most[large], least[small] = shares[large], shares[small]
        middle = np.sqrt(np.maximum(least, 0.01 * most) * most)
        guess = shares / np.clip(sizes, 1e-3, 1e3)
        shares = np.where(large | small, np.where((least < guess) & (guess < most), guess, middle), shares)
    return shares, np.where(np.isfinite(columns), columns, 0.0)
