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

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.data.force_experiment import ForceExperiment
from cfd_pneumatic.identification.data.motion import Motion
from cfd_pneumatic.identification.data.split import Split, split_recordings, stroke_times
from cfd_pneumatic.identification.fit.extension import Extension, simulate_models, tangent
from cfd_pneumatic.identification.fit.force import fit_force, hold_several_levels, starting_force_data
from cfd_pneumatic.identification.fit.starts import starting_data
from cfd_pneumatic.identification.search.stepwise import SHOWN, STRENGTH
from cfd_pneumatic.model import DIRECTIONS, SPECS, Course
from cfd_pneumatic.model.effects import FORCE_EFFECTS, PRESSURE_EFFECTS, Effect
from cfd_pneumatic.model.extended_force import ExtendedForce
from cfd_pneumatic.parallel import each
from cfd_pneumatic.planning.device import PlannedCylinder, PlannedDevice
from cfd_pneumatic.planning.limits import Sensing
from cfd_pneumatic.planning.proposal import Proposal

Array = NDArray[np.float64]

FORCE = 'force'
"""Name of the channel that is not a cylinder's pressure."""

Changes = Callable[[str, Sequence[tuple[float, ...]]], Array]
"""Returns by what an effect with each of some parameters changes what is measured, shape (n, changes)."""

_ATTEMPTS = 8
_NEARLY = 1.2  # times as large, or as small
_VARIED = 2.0  # times

OF_TIME = ('set_point_drift', 'supply_variation')
"""Effects of the time alone: how long a recording is tells them, whatever is done in it."""


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
        Of these, where they have a name; standard errors are told as shares of them.
    forms
        Of effects that may be missing.
    untold
        Effects that may be missing and can't be told, whatever they are like: the motion is too quick for the samples.
    columns
        By what is fitted anyway, then the change that each form makes, shape (n, own + forms) [Pa or N].

    """

    channel: str
    noise: float
    own: tuple[str, ...]
    values: Array
    forms: tuple[Form, ...]
    untold: tuple[str, ...]
    columns: Array

    def products(self, samples: slice | NDArray[np.bool_] = slice(None)) -> Array:
        """Return the scalar products of all columns over some samples, in units of the noise."""
        chosen = self.columns[samples] / self.noise
        return np.asarray(chosen.T @ chosen)


def all_signatures(proposal: Proposal, device: PlannedDevice, sensing: Sensing) -> list[Signatures]:
    """Return the signatures of each channel of a device."""
    experiments = {name: experiment_of(proposal, device, name, sensing) for name in device.cylinders}
    found = [
        _of_pressure(name, experiments[name], device.cylinders[name], device.ambient_pressure, sensing)
        for name in experiments
    ]
    return [*found, _of_force(proposal, experiments, device, sensing)]


def split_of(proposal: Proposal, sensing: Sensing) -> Split:
    """Return where `identify_bag` will cut the recording."""
    (split,), _ = split_recordings([stroke_times(proposal.times, proposal.displacement, sensing.displacement_noise)])
    return split


def pressure_noise(gains: Array, sensing: Sensing) -> float:
    """Return the standard deviation that noise gives a pressure's residual, the displacement's at its worst [Pa]."""
    return float(np.hypot(sensing.pressure_noise, gains[0] * sensing.displacement_noise))


def experiment_of(proposal: Proposal, device: PlannedDevice, name: str, sensing: Sensing) -> Experiment:
    """Return one cylinder in the recording that a proposal would give, without noise."""
    cylinder = device.cylinders[name]
    times, x = proposal.times, DIRECTIONS[name] * proposal.displacement
    setpoint = proposal.setpoints[:, CYLINDERS.index(name)] + device.ambient_pressure
    experiment = Experiment(
        recording='proposal',
        cylinder=name,
        times=times,
        displacement=x,
        setpoint=setpoint,
        setpoint_recorded=True,
        samples=np.arange(times.size),
        pressure=setpoint,
        part=split_of(proposal, sensing).part_of(times),
        starts_at_rest=True,
        motion=_motion_of(proposal, sensing),
    )
    (pressure,) = model_of(cylinder).simulate([experiment], device.ambient_pressure)
    return replace(experiment, pressure=pressure)


def _motion_of(proposal: Proposal, sensing: Sensing) -> Motion:
    """Return the motion as the smoother would have it at best."""
    return Motion(
        times=proposal.times,
        displacement=proposal.displacement,
        rate=proposal.velocity,
        acceleration=proposal.acceleration,
        std=np.full(proposal.times.size, sensing.displacement_noise),
        reach=float(np.ptp(proposal.displacement)),
        noise=sensing.displacement_noise,
        order=2,
        deviance=0.0,
        stamps=proposal.times,
    )


def model_of(cylinder: PlannedCylinder) -> Extension:
    """Return the model that `identify_bag` would find."""
    return Extension(cylinder.gains, cylinder.effects, (0.0,), (0.0,))


def _of_pressure(
    name: str, experiment: Experiment, cylinder: PlannedCylinder, ambient_pressure: float, sensing: Sensing
) -> Signatures:
    model = model_of(cylinder)
    noise = pressure_noise(model.gains, sensing)
    data = {
        **starting_data([experiment], model, [experiment.pressure], ambient_pressure),
        'residual': STRENGTH * noise,
        'lag': 0.0,
    }

    def changes(effect: str, ones: Sequence[tuple[float, ...]]) -> Array:
        models = [Extension(model.gains, {**model.effects, effect: own}, (0.0,), (0.0,)) for own in ones]
        (pressures,) = simulate_models([experiment], models, ambient_pressure)
        return pressures - experiment.pressure[:, None]

    missing = {effect: one for effect, one in PRESSURE_EFFECTS.items() if effect not in model.effects}
    names, values, own = _own_of_pressure(experiment, model, ambient_pressure)
    forms, columns = _formed(missing, data, noise, own, changes)
    return Signatures(name, noise, names, values, forms, (), np.column_stack([own, *columns]))


def _own_of_pressure(
    experiment: Experiment, model: Extension, ambient_pressure: float
) -> tuple[tuple[str, ...], Array, Array]:
    """
    Return what is fitted anyway: names, values, and the derivatives of the pressure, shape (n, k).

    Gains count by their logarithms. Without effects the sensitivities are exact.
    """
    if not model.effects:
        course = Course(model.gains, float(experiment.setpoint[0]))
        _, slopes = course.follow(experiment.times, experiment.displacement, experiment.setpoint)
        names = (*(spec.name for spec in SPECS), '')
        own = slopes[:, : len(names)] * np.append(model.gains, 1.0)
        return names, np.append(model.gains, 1.0), own
    everything = np.ones(experiment.samples.size, dtype=np.bool_)
    at = tangent([experiment], [everything], ambient_pressure, model, [np.ones(everything.size)])
    known = dict(zip((spec.name for spec in SPECS), model.gains.tolist()))
    for effect, parameters in model.effects.items():
        for parameter, value in zip(PRESSURE_EFFECTS[effect].parameters, parameters):
            known[f'{effect}.{parameter.name}'] = value
    values = np.array([known.get(name, 1.0) for name in at.names])
    return at.names, values, at.jacobian * np.where(at.logarithmic, 1.0, values)


def _of_force(
    proposal: Proposal, experiments: Mapping[str, Experiment], device: PlannedDevice, sensing: Sensing
) -> Signatures:
    still = np.full(proposal.times.size, device.ambient_pressure)
    pressures = [experiments[name].pressure if name in experiments else still for name in CYLINDERS]
    levels = [experiments[name].setpoint if name in experiments else still for name in CYLINDERS]

    def force(effects: Mapping[str, Sequence[float]]) -> Array:
        model = ExtendedForce(device.area * device.factor, effects, device.ambient_pressure)
        motion = proposal.times, proposal.displacement, proposal.velocity, proposal.acceleration
        return model.simulate(*motion, pressures[0], pressures[1])

    experiment = ForceExperiment(
        recording='proposal',
        times=proposal.times,
        displacement=proposal.displacement,
        rate=proposal.velocity,
        acceleration=proposal.acceleration,
        pressure=pressures[0],
        opposing=pressures[1],
        samples=np.arange(proposal.times.size),
        force=force(device.force_effects),
        level=levels[0] - levels[1],
        part=split_of(proposal, sensing).part_of(proposal.times),
    )
    everything = [np.ones(proposal.times.size, dtype=np.bool_)]
    fitted = fit_force(
        [experiment],
        everything,
        device.ambient_pressure,
        device.area,
        device.factor,
        device.force_effects,
        estimated=False,
    )
    strength = STRENGTH * sensing.force_noise
    data = {
        **starting_force_data([experiment], fitted, device.ambient_pressure),
        'force_residual': strength,
        'force_mean': strength,
    }

    def changes(effect: str, ones: Sequence[tuple[float, ...]]) -> Array:
        return np.column_stack([force({**device.force_effects, effect: own}) - experiment.force for own in ones])

    missing = {name: one for name, one in FORCE_EFFECTS.items() if name not in device.force_effects}
    hidden = () if experiment.resolves_acceleration else tuple({'moving_mass'} & missing.keys())
    visible = {name: one for name, one in missing.items() if name not in hidden}
    own = fitted.jacobian
    forms, columns = _formed(visible, data, sensing.force_noise, own, changes)
    area = ('area',) if hold_several_levels([experiment], everything) else ()
    names = (*area, *('',) * (own.shape[1] - len(area)))
    values = np.full(len(names), device.area)
    return Signatures(FORCE, sensing.force_noise, names, values, forms, hidden, np.column_stack([own, *columns]))


def _formed(
    library: Mapping[str, Effect], data: Mapping[str, float], noise: float, own: Array, changes: Changes
) -> tuple[tuple[Form, ...], list[Array]]:
    """Return the forms of effects and their signatures, each where it just shows beside what is fitted anyway."""
    size = np.linalg.norm(own, axis=0)
    basis = np.linalg.qr(own[:, size > 0.0] / size[size > 0.0])[0]

    def visibility(columns: Array) -> Array:
        left = columns - basis @ (basis.T @ columns)
        return np.asarray(np.sqrt(np.mean(left**2, axis=0)) / (SHOWN * noise))

    def of_effect(name: str) -> tuple[list[Form], Array]:
        effect = library[name]
        typical = [one for one in effect.starts(data) if effect.of_strength(one, 0.5) != one]  # without strength: none
        shares, columns = _just_showing(typical, effect, lambda ones: changes(name, ones), visibility)
        forms = [Form(name, one, share) for one, share in zip(typical, shares.tolist())]
        varied = [replace(form, typical=other, varied=True) for form in forms for other in _varied(form, effect)]
        if not varied:
            return forms, columns
        more = changes(name, [effect.of_strength(form.typical, form.share) for form in varied])
        return [*forms, *varied], np.column_stack([columns, np.where(np.isfinite(more), more, 0.0)])

    found = each(of_effect, list(library))
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
