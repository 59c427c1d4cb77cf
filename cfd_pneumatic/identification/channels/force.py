# SPDX-License-Identifier: Apache-2.0
"""
The contact force: piston area times geometric factor times the difference of the measured pressures.

The pressures are the measured ones, so that what the pressure's model lacks is not laid on the force. Of area and
geometric factor only the product shows: the factor is held as given, and so is the area where all recordings have one
set-point, for there an offset of the force is as good as any area.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.ndimage import uniform_filter1d

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AREAS, CONTACT_FORCE, CYLINDERS, MEASURED_FORCE, WRENCH_STAMPED
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.channels.channel import EVEN, Channel, Curve, Estimate, Model, Quantity, Scale
from cfd_pneumatic.identification.channels.unknown import Unknown
from cfd_pneumatic.identification.data import (
    FEWEST_SAMPLES,
    Experiment,
    Motion,
    Options,
    Split,
    rests_at_start,
    reversals,
    seal_displacement,
)
from cfd_pneumatic.identification.residual import Regressors, autoregression, independent_share, runs_at_rest
from cfd_pneumatic.model import FORCE_CURVE, FORCE_EFFECTS, FORCE_PARTS, Data, ExtendedForce
from cfd_pneumatic.model import FORCE_CURVE_AGAINST as AGAINST
from cfd_pneumatic.model import FORCE_CURVE_ENTERS as ENTERS
from cfd_pneumatic.notices import SuspectError, warning
from cfd_pneumatic.recording import Recording, Signal
from cfd_pneumatic.units import POUND_FORCE

_LARGEST_RATIO = 1.5  # farther from where it begins the area is not searched
_LEVEL_GAP = 0.03  # set-points closer than this share of the pressure tell the area no better than one
_SMOOTHED = 25  # samples
_SLOW = 0.05  # share of the speed's spread at which the piston stands, as far as friction goes
_ROUGH = 0.3  # share of an acceleration that may stray from its neighbours' mean
_TIED = 3.2  # standard errors: by so much the criterion tells as little as between tied effects
_PRESLIDINGS = (5e-5, 5e-4)  # where a law of friction begins [m]
_LEAD = 5  # samples before a stroke, into which a smoothed acceleration reaches
_AREA, _FACTOR = range(2)


class Force(Channel):
    """
    The contact force.

    Inputs of an experiment: `displacement`, `rate`, `acceleration` [m, m/s, m/s^2], +x grows cylinder A; measured
    absolute `pressure` in A and `opposing` in B, ambient where one was not recorded [Pa]; `level`, the set-point of A
    less that of B [Pa]. Each experiment has a `stretch` of the seals at its first sample, -1 to 1 [-].
    """

    name = 'force'
    quantity = Quantity(
        'contact force', 'n', 'area times pressure', Scale('N', 1.0), Scale('lbf', POUND_FORCE), Scale('N', 1.0)
    )
    topics = MEASURED_FORCE, CONTACT_FORCE
    msgtype = WRENCH_STAMPED
    effects = FORCE_PARTS
    library = FORCE_EFFECTS
    curve = Curve(
        FORCE_CURVE,
        ENTERS,
        AGAINST,
        asked={
            'x': ENTERS,
            'speed': ('force', 'friction'),
            'p': ('force', 'friction'),
            'force': ('friction', 'cell'),
            'time': ENTERS,
        },
        memory=_PRESLIDINGS[0],
        memories={('friction', variable): _PRESLIDINGS for variable in AGAINST},
        both_ways=('speed',),
        crowds=(EVEN, 1.0, 0.5),
        whole=('x', 'time'),
    )
    parameters = MappingProxyType({'area': 'm^2', 'geometric_factor': '-'})
    own = ('stretch',)
    immaterial = 1e-4

    def __init__(self, area: float | None, factor: float, ambient_pressure: float) -> None:
        self.area = area
        self.factor = factor
        self.ambient_pressure = ambient_pressure

    @classmethod
    def found_in(cls, recordings: Sequence[Recording], options: Options) -> list[Force]:
        """Return it where a force was recorded."""
        factor = 1.0 if options.geometric_factor is None else options.geometric_factor
        channel = cls(options.area, factor, options.ambient_pressure)
        return [channel] if any(channel.signal(recording) is not None for recording in recordings) else []

    def signal(self, recording: Recording) -> Signal | None:
        """Return the measured force."""
        return recording.force

    def experiment(self, recording: Recording, motion: Motion, split: Split) -> Experiment:
        """Return the force in a recording; the grid holds the piston's reversals: friction sees each of them."""
        signal = self.signal(recording)
        assert signal is not None
        stamps = motion.clock_of(signal.times)
        within = self.within(recording, motion, stamps)
        sampled, force = stamps[within], signal.values[within]
        if force.size < FEWEST_SAMPLES:
            raise InputError(
                f'{recording.name}: only {force.size} samples of the force lie between the first and the last sample '
                'of displacement and pressure: check the time offsets of the topics'
            )
        if np.ptp(force) == 0.0:
            raise InputError(f'{recording.name}: the force never changes ({force[0]:g} N): is its sensor connected?')
        times, inputs = self.driven(recording, motion, sampled)
        return Experiment(
            recording=recording.name,
            times=times,
            inputs=inputs,
            samples=np.searchsorted(times, sampled),
            measured=force,
            part=split.part_of(sampled),
            motion=motion,
            starts_at_rest=rests_at_start(motion),
        )

    def within(self, recording: Recording, motion: Motion, times: Array) -> slice:
        """Return which of increasing times lie between the first and the last of displacement and pressures [s]."""
        signals = [motion.times, *(motion.clock_of(one.pressure.times) for one in recording.cylinders.values())]
        first, last = max(one[0] for one in signals), min(one[-1] for one in signals)
        begin, end = np.searchsorted(times, [first, np.nextafter(last, np.inf)]).tolist()
        return slice(begin, end)

    def driven(self, recording: Recording, motion: Motion, sampled: Array) -> tuple[Array, dict[str, Array]]:
        """Return a grid that holds sample times, shape (n,) [s], and the inputs on it."""
        moved = np.concatenate([motion.times, reversals(motion)])
        times = np.union1d(moved[(moved >= sampled[0]) & (moved <= sampled[-1])], sampled)
        pressures = [self._pressure(recording, name, motion, times) for name in CYLINDERS]
        levels = [self._level(recording, name, motion, times) for name in CYLINDERS]
        inputs = {
            'displacement': seal_displacement(motion, recording.displacement.values, times),
            'rate': motion.rate_at(times),
            'acceleration': motion.acceleration_at(times),
            'pressure': pressures[0],
            'opposing': pressures[1],
            'level': levels[0] - levels[1],
        }
        return times, inputs

    def _pressure(self, recording: Recording, cylinder: str, motion: Motion, times: Array) -> Array:
        """Return a cylinder's pressure, or ambient [Pa]."""
        signals = recording.cylinders.get(cylinder)
        if signals is None:
            return np.full(times.size, self.ambient_pressure)
        return np.interp(times, motion.clock_of(signals.pressure.times), signals.pressure.values)

    def _level(self, recording: Recording, cylinder: str, motion: Motion, times: Array) -> Array:
        """Return a cylinder's set-point, its median pressure where none was recorded, or ambient [Pa]."""
        signals = recording.cylinders.get(cylinder)
        if signals is None:
            return np.full(times.size, self.ambient_pressure)
        if signals.setpoint is None:
            return np.full(times.size, float(np.median(signals.pressure.values)))
        held = np.searchsorted(motion.on_clock(signals.setpoint.times), times, side='right') - 1
        return signals.setpoint.values[np.maximum(held, 0)]

    # the area

    def starts(self, experiments: Sequence[Experiment]) -> list[Model]:
        """Return one model, with the area to begin at."""
        own = np.zeros((len(experiments), len(self.own)))
        return [Model(np.array([self._first_area(experiments), self.factor]), {}, own)]

    def _first_area(self, experiments: Sequence[Experiment]) -> float:
        """Return the area to begin at: the one that was given, or what the recordings tell [m^2]."""
        if self.area is not None and not _hold_several_levels(experiments):
            return self.area
        told = self.told_area(experiments)
        return told if self.area is None else self.area

    def told_area(self, experiments: Sequence[Experiment]) -> float:
        """
        Return the area that force and pressures make [m^2].

        At one set-point by a line through zero: friction, which follows the pressure as both follow the motion, hardly
        tilts it.

        Raises
        ------
        InputError
            If the force falls with the pressure.

        """
        differences = np.concatenate([_difference(one)[one.counts] for one in experiments])
        forces = np.concatenate([one.measured[one.counts] for one in experiments])
        if _hold_several_levels(experiments):
            slope = float(np.polyfit(differences, forces, 1)[0]) / self.factor
            if not slope > 0.0:
                raise _against('falls while the pressure difference grows')
            return slope
        area = float(forces @ differences) / float(differences @ differences) / self.factor
        if not area > 0.0:
            raise _against('is against the pressure difference')
        return area

    def searched(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return the area where there are several set-points, and the seals' stretches where anything slides."""
        found = []
        if 'area' not in self.held(experiments, model):
            area = self._first_area(experiments)
            found.append(Unknown('area', 'm^2', _AREA, area / _LARGEST_RATIO, area * _LARGEST_RATIO, area))
        if any(self.effects[name].states for name in model.effects if name != FORCE_CURVE or _rubs(model)):
            for index in sorted({one.index for one in experiments if one.starts_with_recording}):
                found.append(Unknown('', '1', self.own_slots(index)[0], -1.0, 1.0, 1.0))
        return found

    def held(self, experiments: Sequence[Experiment], model: Model) -> Mapping[str, str]:
        """Return why the factor, and at one set-point the area, is not searched."""
        reasons = {'geometric_factor': f'only its product with the area shows: it is held at {self.factor:g}'}
        if FORCE_CURVE in model.effects and not _rubs(model):
            reasons[f'{FORCE_CURVE}.presliding'] = 'nothing turns round'
        if not _hold_several_levels(experiments):
            level = float(np.median(np.concatenate([one.at_samples('level') for one in experiments])))
            reasons['area'] = (
                f'all recordings have one set-point, {level:.0f} Pa: record a second one '
                f'(it is held at {model.parameters[_AREA] * 1e6:.1f} mm^2)'
            )
            for effect in model.effects:
                for parameter in self.effects[effect].parameters:
                    if parameter.of_pressure:
                        reasons[f'{effect}.{parameter.name}'] = 'one set-point does not tell it'
        return reasons

    def check(
        self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model, estimates: Sequence[Estimate]
    ) -> None:
        """Raise InputError where the area is none that a piston has."""
        area = float(model.parameters[_AREA])
        if not AREAS[0] <= area <= AREAS[1]:
            raise SuspectError(
                warning(
                    'unit_suspect',
                    f'the force makes the piston area {area:.3g} m^2, outside {AREAS[0]:g} to {AREAS[1]:g} m^2',
                    'check the units of force and pressure',
                )
            )

    # what recordings can tell

    def may_tell(self, experiments: Sequence[Experiment], effect: str, model: Model) -> bool:
        """Return whether an effect shows beside the area, and beside an inertia that the samples do not resolve."""
        if self.effects[effect].constant:
            return self._tells_constants(experiments)
        inert = any(self.effects[name].seen_against == 'acceleration' for name in model.effects)
        return not inert or _resolve_acceleration(experiments)  # what it leaves behind then looks like friction

    def unidentifiable(self, experiments: Sequence[Experiment], effect: str) -> str | None:
        """Return that an acceleration which is not resolved tells nothing."""
        if self.effects[effect].seen_against != 'acceleration' or _resolve_acceleration(experiments):
            return None
        return 'the acceleration changes from sample to sample: sample faster'

    def _tells_constants(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether an area that is off can't pass for what the force has always."""
        return self.area is not None or _hold_several_levels(experiments)

    def may_hide(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether inertia is not resolved: a curve that takes some of it leaves the rest."""
        return not _resolve_acceleration(experiments)

    def confounded(
        self,
        experiments: Sequence[Experiment],
        model: Model,
        estimates: Sequence[Estimate],
        residual: Array,
        left: Callable[[str, tuple[float, ...]], Array],
    ) -> Mapping[str, tuple[str, ...]]:
        """Return constants that may be the weight of a mass on an incline, whose inertia would not have shown."""
        found = {}
        for name in model.effects:
            if not self.effects[name].constant:
                continue
            for other, effect in self.library.items():
                if effect.as_constant is None:
                    continue
                weakest = effect.as_constant(model.effects[name][0])
                if other in model.effects:
                    (own,) = (one for one in estimates if one.name == f'{other}.{effect.parameters[0].name}')
                    may_be = own.value is None or own.std is None or weakest[0] <= own.value + _TIED * own.std
                else:
                    signature = left(other, weakest)
                    size = float(np.linalg.norm(signature))
                    may_be = size == 0.0 or not _resolve_acceleration(experiments)
                    if not may_be:
                        independent = independent_share(autoregression([residual]))
                        std = math.sqrt(float(np.mean(residual**2)) / independent) / size
                        may_be = float(signature @ residual) / size**2 + _TIED * std >= 1.0
                if may_be:
                    found[name] = (other,)
        return found

    # model and residual

    def follow(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int
    ) -> Iterator[tuple[slice, Array]]:
        """Yield the forces."""
        names = ('displacement', 'rate', 'acceleration', 'pressure', 'opposing')
        models = [
            ExtendedForce(
                row[_AREA] * row[_FACTOR],
                {name: row[list(self.slots_of(name))] for name in effects},
                self.ambient_pressure,
            )
            for row in rows
        ]
        moving = float(_direction(experiment.inputs['rate'])[0])  # in whose direction the seals are stretched then
        stretches = rows[:, -1].tolist() if experiment.starts_with_recording else [moving] * len(rows)
        states = [one.begin(experiment.inputs['displacement'][0], own) for one, own in zip(models, stretches)]
        for block in experiment.blocks(count):
            piece = block.times, *(block.inputs[name] for name in names)
            forces = [
                one.follow(state, experiment.begin, *piece)[block.sample_indices] for one, state in zip(models, states)
            ]
            yield block.samples, np.column_stack(forces)

    def sensitivity(self, model: Model) -> float:
        """Return zero: the measured pressures have it in them."""
        return 0.0

    def rests(self, experiment: Experiment, residual: Array) -> list[Array]:
        """Return the runs of the residual while displacement and set-points rest."""
        displacement, level = experiment.at_samples('displacement'), experiment.at_samples('level')
        runs = runs_at_rest(experiment.sample_times, displacement, level, 0.0, residual)
        return [run[:-_LEAD] for run in runs]

    def variables(self, experiment: Experiment, simulated: Array, model: Model) -> Mapping[str, Array]:
        """Return what a law may depend on; the force is that without it."""
        others = {name: own for name, own in model.effects.items() if name != FORCE_CURVE}
        if FORCE_CURVE in model.effects:
            (simulated,) = self.simulated([experiment], replace(model, effects=others))
        gauge = experiment.at_samples('pressure') + experiment.at_samples('opposing') - 2.0 * self.ambient_pressure
        return {
            'x': experiment.at_samples('displacement'),
            'speed': experiment.at_samples('rate'),
            'p': gauge,
            'force': simulated,
            'time': experiment.sample_times - experiment.begin,
        }

    def law_units(
        self, experiments: Sequence[Experiment], model: Model, noise: float, most: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Return the noise's size, and a hundredth of what the cell reads; none where a wrong area looks like a law."""
        return {'force': noise, 'friction': noise, 'cell': 1e-2} if self._tells_constants(experiments) else {}

    def regressors(self, experiment: Experiment, simulated: Array, weight: Array) -> Regressors:
        """Return motion, pressures and their products."""
        x, rate, acceleration = (experiment.at_samples(name) for name in ('displacement', 'rate', 'acceleration'))
        # smoothed: the noise of the pressures, which the residual has in it, would pass for a dependence on them
        difference = uniform_filter1d(_difference(experiment), _SMOOTHED, mode='nearest')
        both = experiment.at_samples('pressure') + experiment.at_samples('opposing')
        gauge = uniform_filter1d(both, _SMOOTHED, mode='nearest')
        change = np.gradient(difference)
        centred = (x - np.mean(x)) / max(float(np.std(x)), 1e-12)
        level = difference - np.mean(difference)
        direction = _direction(rate)
        lagged = [rate, direction, np.abs(direction), acceleration]
        once = [x, difference, gauge, change, centred * rate, centred * difference, gauge * direction, gauge * rate]
        once += [x * x, level * level, rate * np.abs(rate), np.abs(acceleration), centred * direction]
        return Regressors(once, lagged, weight, int(np.argmax(experiment.counts)))

    def data(self, experiments: Sequence[Experiment], model: Model, simulated: Sequence[Array]) -> Data:
        """
        Return what effects draw their starting values from.

        =======================================  =======================================================
        `residual`, `mean` [N]                   spread and mean of what a fit leaves of the force
        `gauge` [Pa]                             median gauge pressure, both cylinders added
        `largest_speed` [m/s]                    of the piston, but for the fastest hundredth
        `largest_acceleration` [m/s^2]           likewise
        =======================================  =======================================================
        """
        residual = np.concatenate([one.measured - force for one, force in zip(experiments, simulated)])
        rate, acceleration, pressure, opposing = (
            np.concatenate([one.inputs[name] for one in experiments])
            for name in ('rate', 'acceleration', 'pressure', 'opposing')
        )
        gauge = float(np.median(pressure + opposing)) - 2.0 * self.ambient_pressure
        return {
            'residual': max(float(np.std(residual)), 1e-3),
            'mean': float(np.mean(residual)),
            'lag': 0.0,
            'gauge': max(gauge, 1e3),
            'largest_speed': max(float(np.percentile(np.abs(rate), 99.0)), 1e-5),
            'largest_acceleration': max(float(np.percentile(np.abs(acceleration), 99.0)), 1e-3),
        }

    def shown(self, experiment: Experiment) -> Mapping[str, Array]:
        """Return displacement, speed and the pressures' difference."""
        return {
            'displacement': experiment.at_samples('displacement'),
            'piston speed': experiment.at_samples('rate'),
            'pressure difference': _difference(experiment),
        }


def _rubs(model: Model) -> bool:
    """Return whether a law that a model has is one of friction."""
    return FORCE_CURVE in model.effects and ENTERS[round(model.effects[FORCE_CURVE][0])] == 'friction'


def _against(what: str) -> SuspectError:
    return SuspectError(warning('sign_suspect', f'the force {what}', 'check the sign of the force'))


def _difference(experiment: Experiment) -> Array:
    """Return the pressure in A less that in B at the samples, shape (m,) [Pa]."""
    return experiment.at_samples('pressure') - experiment.at_samples('opposing')


def _direction(rate: Array) -> Array:
    """Return in which direction the piston moves: 1, -1, or 0 where it hardly does, shape (m,)."""
    return np.asarray(np.sign(rate) * (np.abs(rate) > _SLOW * np.std(rate)))


def _hold_several_levels(experiments: Sequence[Experiment]) -> bool:
    """Return whether the samples that count hold more than one set-point, as they must to tell the area."""
    levels = np.concatenate([one.at_samples('level')[one.fitted] for one in experiments])
    return bool(np.ptp(levels) > _LEVEL_GAP * np.max(np.abs(levels)))


def _resolve_acceleration(experiments: Sequence[Experiment]) -> bool:
    """Return whether the acceleration is seen: what changes at every sample comes and goes between them, too."""
    return any(_roughness(one.inputs['acceleration']) <= _ROUGH for one in experiments)


def _roughness(values: Array) -> float:
    """Return by how much values stray from the mean of their neighbours, as a share of their own size."""
    middle = 0.5 * (values[:-2] + values[2:])
    size = float(np.linalg.norm(values))
    return float(np.linalg.norm(values[1:-1] - middle)) / size if size > 0.0 else 0.0
