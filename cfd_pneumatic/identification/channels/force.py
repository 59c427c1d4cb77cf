# SPDX-License-Identifier: Apache-2.0
"""
The contact force: piston area times geometric factor times the difference of the measured pressures.

The model uses measured pressures, so that errors of the pressure's model do not reach the force. Only the product of
area and geometric factor is identifiable: the factor is held as given. The area is held, too, if all recordings have
the same set-point, because an offset of the force then has the effect of an area.
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
from cfd_pneumatic.identification.channels.thresholds import (
    LARGEST_AREA_RATIO,
    LEAD_SAMPLES,
    LEAST_LEVEL_GAP,
    PRESLIDING_STARTS,
    ROUGH_ACCELERATION_SHARE,
    SLOW_SHARE,
    SMOOTHED_SAMPLES,
    TIED_STANDARD_ERRORS,
)
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

_AREA, _FACTOR = range(2)


class Force(Channel):
    """
    The contact force.

    Inputs of an experiment: `displacement`, `rate`, `acceleration` [m, m/s, m/s^2], +x grows cylinder A; measured
    absolute `pressure` in A and `opposing` in B, ambient if not recorded [Pa]; `level`, the set-point of A minus the
    set-point of B [Pa]. Each recording has a `stretch` of the seals at its first sample, -1 to 1 [-].
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
        memory=PRESLIDING_STARTS[0],
        memories={('friction', variable): PRESLIDING_STARTS for variable in AGAINST},
        both_ways=('speed',),
        crowds=(EVEN, 1.0, 0.5),
        whole=('x', 'time'),
    )
    parameters = MappingProxyType({'area': 'm^2', 'geometric_factor': '-'})
    recording_parameters = ('stretch',)
    immaterial = 1e-4

    def __init__(self, area: float | None, factor: float, ambient_pressure: float) -> None:
        self.area = area
        self.factor = factor
        self.ambient_pressure = ambient_pressure

    @classmethod
    def found_in(cls, recordings: Sequence[Recording], options: Options) -> list[Force]:
        """Return the channel if a force was recorded."""
        factor = 1.0 if options.geometric_factor is None else options.geometric_factor
        channel = cls(options.area, factor, options.ambient_pressure)
        return [channel] if any(channel.signal(recording) is not None for recording in recordings) else []

    def signal(self, recording: Recording) -> Signal | None:
        """Return the measured force."""
        return recording.force

    def experiment(self, recording: Recording, motion: Motion, split: Split) -> Experiment:
        """Return the force in a recording; the grid holds the piston's reversals, at each of which friction changes."""
        signal = self.signal(recording)
        assert signal is not None
        stamps = motion.clock_of(signal.times)
        within = self.within(recording, motion, stamps)
        sampled, force = stamps[within], signal.values[within]
        if force.size < FEWEST_SAMPLES:
            raise InputError(
                f'{recording.name}: only {force.size} samples of the force are between the first and the last sample '
                f'of displacement and pressure. A fit needs {FEWEST_SAMPLES}. Check the time offsets of the topics'
            )
        if np.ptp(force) == 0.0:
            raise InputError(
                f'{recording.name}: the force never changes ({force[0]:g} N). Check whether its sensor is connected'
            )
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
        """Return the slice of increasing times [s] during which displacement and pressures are recorded."""
        all_times = [
            motion.times,
            *(motion.clock_of(cylinder.pressure.times) for cylinder in recording.cylinders.values()),
        ]
        first, last = max(series[0] for series in all_times), min(series[-1] for series in all_times)
        begin, end = np.searchsorted(times, [first, np.nextafter(last, np.inf)]).tolist()
        return slice(begin, end)

    def driven(self, recording: Recording, motion: Motion, sampled: Array) -> tuple[Array, dict[str, Array]]:
        """Return a grid that holds the sampling times, shape (n,) [s], and the inputs on the grid."""
        knots = np.concatenate([motion.times, reversals(motion)])
        times = np.union1d(knots[(knots >= sampled[0]) & (knots <= sampled[-1])], sampled)
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
        """Return a cylinder's pressure, or ambient pressure if not recorded, shape (n,) [Pa]."""
        signals = recording.cylinders.get(cylinder)
        if signals is None:
            return np.full(times.size, self.ambient_pressure)
        return np.interp(times, motion.clock_of(signals.pressure.times), signals.pressure.values)

    def _level(self, recording: Recording, cylinder: str, motion: Motion, times: Array) -> Array:
        """Return a cylinder's set-point, its median pressure, or ambient pressure, as recorded, shape (n,) [Pa]."""
        signals = recording.cylinders.get(cylinder)
        if signals is None:
            return np.full(times.size, self.ambient_pressure)
        if signals.setpoint is None:
            return np.full(times.size, float(np.median(signals.pressure.values)))
        indices = np.searchsorted(motion.on_clock(signals.setpoint.times), times, side='right') - 1
        return signals.setpoint.values[np.maximum(indices, 0)]

    # the area

    def starts(self, experiments: Sequence[Experiment]) -> list[Model]:
        """Return a model with the start of the area."""
        recording_values = np.zeros((len(experiments), len(self.recording_parameters)))
        return [Model(np.array([self._start_area(experiments), self.factor]), {}, recording_values)]

    def _start_area(self, experiments: Sequence[Experiment]) -> float:
        """Return the start of the area: the given area, or an estimate from the recordings [m^2]."""
        if self.area is not None and not _have_several_setpoints(experiments):
            return self.area
        area = self.estimated_area(experiments)
        return area if self.area is None else self.area

    def estimated_area(self, experiments: Sequence[Experiment]) -> float:
        """
        Estimate the area from force and pressures [m^2].

        At a single set-point the estimate is the slope of a line through zero. Friction hardly tilts this line,
        although friction and pressure both depend on the motion.

        Raises
        ------
        InputError
            If the force decreases with the pressure.

        """
        differences = np.concatenate(
            [_pressure_difference(experiment)[experiment.counts] for experiment in experiments]
        )
        forces = np.concatenate([experiment.measured[experiment.counts] for experiment in experiments])
        if _have_several_setpoints(experiments):
            slope = float(np.polyfit(differences, forces, 1)[0]) / self.factor
            if not slope > 0.0:
                raise _sign_error('falls while the pressure difference grows')
            return slope
        area = float(forces @ differences) / float(differences @ differences) / self.factor
        if not area > 0.0:
            raise _sign_error('acts against the pressure difference')
        return area

    def searched(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return the area if there are several set-points, and the seals' stretches if the model has friction."""
        unknowns = []
        if 'area' not in self.held(experiments, model):
            area = self._start_area(experiments)
            unknowns.append(Unknown('area', 'm^2', _AREA, area / LARGEST_AREA_RATIO, area * LARGEST_AREA_RATIO, area))
        if any(
            self.effects[name].states for name in model.effects if name != FORCE_CURVE or _has_friction_curve(model)
        ):
            for index in sorted({experiment.index for experiment in experiments if experiment.starts_with_recording}):
                unknowns.append(Unknown('', '1', self.recording_slots(index)[0], -1.0, 1.0, 1.0))
        return unknowns

    def held(self, experiments: Sequence[Experiment], model: Model) -> Mapping[str, str]:
        """Return why the factor, and the area at a single set-point, are not searched."""
        reasons = {
            'geometric_factor': f'only the product with the area is identifiable; the factor is held at {self.factor:g}'
        }
        if FORCE_CURVE in model.effects and not _has_friction_curve(model):
            reasons[f'{FORCE_CURVE}.presliding'] = 'the curve is not friction'
        if not _have_several_setpoints(experiments):
            level = float(np.median(np.concatenate([experiment.at_samples('level') for experiment in experiments])))
            reasons['area'] = (
                f'all recordings have the same set-point, {level:.0f} Pa. '
                f'The area is held at {model.parameters[_AREA] * 1e6:.1f} mm^2. Record a second set-point'
            )
            for effect in model.effects:
                for parameter in self.effects[effect].parameters:
                    if parameter.of_pressure:
                        reasons[f'{effect}.{parameter.name}'] = 'not identifiable at a single set-point'
        return reasons

    def check(
        self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model, estimates: Sequence[Estimate]
    ) -> None:
        """Raise SuspectError if the area is impossible for a piston."""
        area = float(model.parameters[_AREA])
        if not AREAS[0] <= area <= AREAS[1]:
            raise SuspectError(
                warning(
                    'unit_suspect',
                    f'force and pressure imply an area of {area:.3g} m^2, outside {AREAS[0]:g} to {AREAS[1]:g} m^2',
                    'check the units of force and pressure',
                )
            )

    # identifiability

    def may_tell(self, experiments: Sequence[Experiment], effect: str, model: Model) -> bool:
        """Return whether an effect is distinguishable from the area, and from an inertia that is not resolved."""
        if self.effects[effect].constant:
            return self._determines_constants(experiments)
        has_inertia = any(self.effects[name].seen_against == 'acceleration' for name in model.effects)
        # the residual of an unresolved inertia looks like friction
        return not has_inertia or _is_acceleration_resolved(experiments)

    def unidentifiable(self, experiments: Sequence[Experiment], effect: str) -> str | None:
        """Return the reason if an effect needs an acceleration that the samples do not resolve."""
        if self.effects[effect].seen_against != 'acceleration' or _is_acceleration_resolved(experiments):
            return None
        return 'the acceleration changes from sample to sample. Sample faster'

    def _determines_constants(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether a wrong area is distinguishable from a constant force."""
        return self.area is not None or _have_several_setpoints(experiments)

    def may_hide(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether inertia is not resolved: a curve would explain a part of the inertia only."""
        return not _is_acceleration_resolved(experiments)

    def confounded(
        self,
        experiments: Sequence[Experiment],
        model: Model,
        estimates: Sequence[Estimate],
        residual: Array,
        unexplained_effect: Callable[[str, tuple[float, ...]], Array],
    ) -> Mapping[str, tuple[str, ...]]:
        """Return constant forces that may be the weight of a mass on an incline with an inertia too small to show."""
        confounded = {}
        for name in model.effects:
            if not self.effects[name].constant:
                continue
            for library_effect, effect in self.library.items():
                if effect.as_constant is None:
                    continue
                weakest = effect.as_constant(model.effects[name][0])
                if library_effect in model.effects:
                    (estimate,) = (
                        entry for entry in estimates if entry.name == f'{library_effect}.{effect.parameters[0].name}'
                    )
                    may_be = (
                        estimate.value is None
                        or estimate.std is None
                        or weakest[0] <= estimate.value + TIED_STANDARD_ERRORS * estimate.std
                    )
                else:
                    signature = unexplained_effect(library_effect, weakest)
                    size = float(np.linalg.norm(signature))
                    may_be = size == 0.0 or not _is_acceleration_resolved(experiments)
                    if not may_be:
                        independent = independent_share(autoregression([residual]))
                        std = math.sqrt(float(np.mean(residual**2)) / independent) / size
                        may_be = float(signature @ residual) / size**2 + TIED_STANDARD_ERRORS * std >= 1.0
                if may_be:
                    confounded[name] = (library_effect,)
        return confounded

    # model and residual

    def simulated_pieces(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int
    ) -> Iterator[tuple[slice, Array]]:
        """Yield simulated forces, in pieces."""
        names = ('displacement', 'rate', 'acceleration', 'pressure', 'opposing')
        models = [
            ExtendedForce(
                row[_AREA] * row[_FACTOR],
                {name: row[list(self.slots_of(name))] for name in effects},
                self.ambient_pressure,
            )
            for row in rows
        ]
        direction = float(_direction(experiment.inputs['rate'])[0])  # seals in motion are stretched in this direction
        stretches = rows[:, -1].tolist() if experiment.starts_with_recording else [direction] * len(rows)
        states = [
            model.begin(experiment.inputs['displacement'][0], stretch) for model, stretch in zip(models, stretches)
        ]
        for block in experiment.blocks(count):
            piece = block.times, *(block.inputs[name] for name in names)
            forces = [
                model.simulate_piece(state, experiment.begin, *piece)[block.sample_indices]
                for model, state in zip(models, states)
            ]
            yield block.samples, np.column_stack(forces)

    def sensitivity(self, model: Model) -> float:
        """Return zero: the measured pressures include the effect of the displacement."""
        return 0.0

    def rests(self, experiment: Experiment, residual: Array) -> list[Array]:
        """Return the runs of the residual while displacement and set-points rest."""
        displacement, level = experiment.at_samples('displacement'), experiment.at_samples('level')
        runs = runs_at_rest(experiment.sample_times, displacement, level, 0.0, residual)
        return [run[:-LEAD_SAMPLES] for run in runs]

    def variables(self, experiment: Experiment, simulated: Array, model: Model) -> Mapping[str, Array]:
        """Return the variables of a characteristic; the force is simulated without the characteristic."""
        effects = {name: values for name, values in model.effects.items() if name != FORCE_CURVE}
        if FORCE_CURVE in model.effects:
            (simulated,) = self.simulated([experiment], replace(model, effects=effects))
        gauge = experiment.at_samples('pressure') + experiment.at_samples('opposing') - 2.0 * self.ambient_pressure
        return {
            'x': experiment.at_samples('displacement'),
            'speed': experiment.at_samples('rate'),
            'p': gauge,
            'force': simulated,
            'time': experiment.sample_times - experiment.begin,
        }

    def characteristic_units(
        self, experiments: Sequence[Experiment], model: Model, noise: float, most: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Return a small height of an unknown curve for each place: like the noise, or 1 % for factors."""
        return {'force': noise, 'friction': noise, 'cell': 1e-2} if self._determines_constants(experiments) else {}

    def regressors(self, experiment: Experiment, simulated: Array, weight: Array) -> Regressors:
        """Return motion, pressures and products as regressors."""
        x, rate, acceleration = (experiment.at_samples(name) for name in ('displacement', 'rate', 'acceleration'))
        # smoothed: the residual contains the pressures' noise, which would look like a dependence on the pressures
        difference = uniform_filter1d(_pressure_difference(experiment), SMOOTHED_SAMPLES, mode='nearest')
        both = experiment.at_samples('pressure') + experiment.at_samples('opposing')
        gauge = uniform_filter1d(both, SMOOTHED_SAMPLES, mode='nearest')
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
        Return the features for the effects' starting values.

        - `residual`, `mean` [N]: standard deviation and mean of the residual
        - `lag` [s]: 0
        - `gauge` [Pa]: median gauge pressure, sum of both cylinders
        - `largest_speed` [m/s]: 99th percentile of the piston's speed
        - `largest_acceleration` [m/s^2]: 99th percentile of the piston's acceleration
        """
        residual = np.concatenate([experiment.measured - force for experiment, force in zip(experiments, simulated)])
        rate, acceleration, pressure, opposing = (
            np.concatenate([experiment.inputs[name] for experiment in experiments])
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
        """Return displacement, speed and pressure difference."""
        return {
            'displacement': experiment.at_samples('displacement'),
            'piston speed': experiment.at_samples('rate'),
            'pressure difference': _pressure_difference(experiment),
        }


def _has_friction_curve(model: Model) -> bool:
    """Return whether a model has a curve of friction."""
    return FORCE_CURVE in model.effects and ENTERS[round(model.effects[FORCE_CURVE][0])] == 'friction'


def _sign_error(finding: str) -> SuspectError:
    return SuspectError(warning('sign_suspect', f'the force {finding}', 'check the sign of the force'))


def _pressure_difference(experiment: Experiment) -> Array:
    """Return the pressure in A minus the pressure in B at the samples, shape (m,) [Pa]."""
    return experiment.at_samples('pressure') - experiment.at_samples('opposing')


def _direction(rate: Array) -> Array:
    """Return the direction of the piston: 1, -1, or 0 near rest, shape (m,)."""
    return np.asarray(np.sign(rate) * (np.abs(rate) > SLOW_SHARE * np.std(rate)))


def _have_several_setpoints(experiments: Sequence[Experiment]) -> bool:
    """Return whether samples before the test part have several set-points, which determine the area."""
    levels = np.concatenate([experiment.at_samples('level')[experiment.fitted] for experiment in experiments])
    return bool(np.ptp(levels) > LEAST_LEVEL_GAP * np.max(np.abs(levels)))


def _is_acceleration_resolved(experiments: Sequence[Experiment]) -> bool:
    """Return whether the samples resolve the acceleration: it must not change at every sample."""
    return any(_roughness(experiment.inputs['acceleration']) <= ROUGH_ACCELERATION_SHARE for experiment in experiments)


def _roughness(values: Array) -> float:
    """Return the deviation of values from the mean of adjacent values, relative to the values."""
    middle = 0.5 * (values[:-2] + values[2:])
    size = float(np.linalg.norm(values))
    return float(np.linalg.norm(values[1:-1] - middle)) / size if size > 0.0 else 0.0
