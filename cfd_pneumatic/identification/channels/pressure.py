# SPDX-License-Identifier: Apache-2.0
"""A cylinder's pressure: equations (8) and (12) of the paper, exactly integrated if no effect is active."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.ndimage import uniform_filter1d

from cfd_pneumatic.arrays import Array, Indices, rms
from cfd_pneumatic.convention import CYLINDERS, FLUID_PRESSURE, pressure_topic
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.channels.channel import (
    NOT_ESTIMATED,
    Channel,
    Curve,
    Estimate,
    Model,
    Quantity,
    Scale,
    differences,
    stepped,
)
from cfd_pneumatic.identification.channels.thresholds import (
    CURVE_EFFORT,
    EXACT_EFFORT,
    FLOW_LAG_STARTS,
    LARGEST_PRESSURE,
    LARGEST_RATE_PER_SAMPLE,
    LARGEST_START_DISTANCE,
    LEAST_FLOW_LIMIT,
    LEAST_LEVEL_RATIO,
    LEAST_PISTON_EVIDENCE,
    LINEARISED_PERIODS,
    PHYSICAL_EFFORT,
    SENSED_START_TIME,
    SHORTEST_GAP,
    SHORTEST_STROKE,
    SLACK_AT_REST,
)
from cfd_pneumatic.identification.channels.unknown import Unknown
from cfd_pneumatic.identification.data import (
    FEWEST_SAMPLES,
    PARTS,
    Block,
    Experiment,
    Motion,
    Options,
    Split,
    check_range,
    rests_at_start,
    shortest_period,
)
from cfd_pneumatic.identification.residual import (
    Noise,
    Regressors,
    lag_after_steps,
    lag_between,
    runs_at_rest,
    sample_noise,
    speed_in_motion,
    stamp_jitter,
    strongest_frequency,
)
from cfd_pneumatic.model import (
    BOTH_WAYS,
    CORES,
    COUNT,
    CURVE,
    DIRECTIONS,
    HINTS,
    MOVING,
    ONE_WAY,
    PRESSURE_EFFECTS,
    PRESSURE_PARTS,
    SPECS,
    Course,
    Data,
    ExtendedCylinder,
    SideBySide,
    alternative_starts,
    displacement_sensitivity,
    flows,
    identifiable_gain_bounds,
    is_of_flow,
    starting_gains,
)
from cfd_pneumatic.model import CURVE_AGAINST as AGAINST
from cfd_pneumatic.model import CURVE_ENTERS as ENTERS
from cfd_pneumatic.recording import Recording, Signal
from cfd_pneumatic.units import PSI

_SMOOTHED = 25  # samples
_LATE_MOTION = ('reading', 'displacement')  # effects on the times of these move the chamber relative to the samples
_LATE = (*_LATE_MOTION, 'setpoint')  # order of the delays in `Experiment.blocks`
_OFFSET, _START, _DRIFT = range(3)
_OF_OFFSET, _OF_START = len(SPECS), len(SPECS) + 1  # columns of the exact derivatives


class Pressure(Channel):
    """
    The pressure of one cylinder.

    Inputs of an experiment: `displacement` that grows this chamber [m], absolute `setpoint` on the step that ends at
    each grid time [Pa]. Each recording has an `offset` of its set-point, and a `start`, first pressure minus set-point
    [Pa]. A set-point that was not recorded has a `drift`, too: a regulator that is set by hand creeps [Pa/s].
    """

    quantity = Quantity('pressure', 'pa', 'paper’s model', Scale('Pa', 1.0), Scale('psi', PSI), Scale('kPa', 1e3))
    msgtype = FLUID_PRESSURE
    effects = PRESSURE_PARTS
    cores = CORES
    library = PRESSURE_EFFECTS
    curve = Curve(
        CURVE,
        ENTERS,
        AGAINST,
        asked={
            'x': ENTERS,
            'speed': ('set_point', 'gain', 'chamber', 'leak'),
            'p': BOTH_WAYS,
            'error': ('flow', 'gain'),  # a curve at the chamber is equivalent to a curve of the flow
            'flow': ('flow', 'set_point'),
            'time': ('set_point', 'flow', 'gain', 'sensing'),
        },
        memory=FLOW_LAG_STARTS[0],
        memories={('flow', 'flow'): FLOW_LAG_STARTS, ('set_point', 'flow'): FLOW_LAG_STARTS},
        both_ways=('speed', 'error', 'flow'),
    )
    parameters = MappingProxyType({spec.name: spec.unit for spec in SPECS})
    hints = HINTS
    recording_parameters = ('offset', 'start', 'drift')
    needed = True

    def __init__(self, cylinder: str, ambient_pressure: float) -> None:
        self.name = cylinder
        self.topics = pressure_topic(cylinder), pressure_topic(cylinder)
        self.ambient_pressure = ambient_pressure

    @classmethod
    def found_in(cls, recordings: Sequence[Recording], options: Options) -> list[Pressure]:
        """Return a channel for each cylinder with a recorded pressure."""
        present = [name for name in CYLINDERS if any(name in recording.cylinders for recording in recordings)]
        return [cls(name, options.ambient_pressure) for name in present]

    def signal(self, recording: Recording) -> Signal | None:
        """Return the cylinder's pressure."""
        signals = recording.cylinders.get(self.name)
        return None if signals is None else signals.pressure

    def experiment(self, recording: Recording, motion: Motion, split: Split) -> Experiment:
        """Return the cylinder's pressure in a recording."""
        signals = recording.cylinders[self.name]
        times_of_sampling = motion.clock_of(signals.pressure.times)
        during = motion.during(times_of_sampling)
        sampled, pressure = times_of_sampling[during], signals.pressure.values[during]
        self._check(recording.name, pressure)
        before_test = pressure[: np.searchsorted(sampled, split.bounds[1])]
        level = float(np.median(before_test if before_test.size else pressure))
        times, inputs = self.driven(motion, level if signals.setpoint is None else signals.setpoint, sampled)
        at_rest, part = rests_at_start(motion), split.part_of(sampled)
        known = sampled >= sampled[0] + SENSED_START_TIME
        return Experiment(
            recording=recording.name,
            times=times,
            inputs=inputs,
            samples=np.searchsorted(times, sampled),
            measured=pressure,
            part=part,
            motion=motion,
            starts_at_rest=at_rest,
            drifts=signals.setpoint is None,
            chosen=None if at_rest else known & (part < PARTS.index('test')),
        )

    def driven(self, motion: Motion, setpoint: Signal | float, sampled: Array) -> tuple[Array, dict[str, Array]]:
        """Return a grid with the sampling times, shape (n,) [s], and the inputs there; set-points are absolute [Pa]."""
        changed, levels = motion.times[:1], np.array([setpoint])
        if isinstance(setpoint, Signal):
            changed, levels = motion.on_clock(setpoint.times), setpoint.values
        times, displacement = motion.on_grid(sampled, changed)
        step_begins = np.append(motion.times[0], times[:-1])
        indices = np.searchsorted(changed, step_begins, side='right') - 1
        return times, {'displacement': DIRECTIONS[self.name] * displacement, 'setpoint': levels[np.maximum(indices, 0)]}

    def _check(self, recording: str, pressure: Array) -> None:
        topic = f'{self.name}/pressure'
        if pressure.size < FEWEST_SAMPLES:
            raise InputError(
                f'{recording}: only {pressure.size} samples of {topic} are between the first and the last displacement '
                f'sample. A fit needs {FEWEST_SAMPLES}. Check the time offsets of both topics'
            )
        if np.ptp(pressure) == 0.0:
            raise InputError(
                f'{recording}: {topic} never changes ({pressure[0]:g} Pa). Check whether its sensor is connected'
            )
        check_range(f'{recording}: {topic}', pressure, LARGEST_PRESSURE, 'Pa')

    def starts(self, experiments: Sequence[Experiment]) -> list[Model]:
        """Return models with the gains of several regulators."""
        pressure = float(
            np.median(np.concatenate([experiment.measured[experiment.counts] for experiment in experiments]))
        )
        stroke = max(float(np.ptp(experiment.inputs['displacement'])) for experiment in experiments)
        recording_values = np.zeros((len(experiments), len(self.recording_parameters)))
        for experiment in experiments:
            recording_values[experiment.index, _START] = (
                0.0 if experiment.starts_at_rest else experiment.first_value - experiment.inputs['setpoint'][0]
            )
        return [Model(gains, {}, recording_values) for gains in starting_gains(pressure, stroke)]

    def beginnings(self, model: Model, astray: bool) -> list[Model]:
        """Return the model, and the model with further gains."""
        return [model, *(replace(model, parameters=gains) for gains in alternative_starts(model.parameters, astray))]

    def limited_for_effects(self, experiments: Sequence[Experiment], model: Model) -> Model:
        """Return the model with bounded gains: a quicker model needs shorter steps of Runge and Kutta."""
        bounds = identifiable_gain_bounds(LINEARISED_PERIODS * shortest_period(experiments))
        return replace(model, parameters=np.clip(model.parameters, *bounds))

    def searched(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return the gains, all offsets, starts of pistons that do not begin at rest, and drifts."""
        bounds = identifiable_gain_bounds(shortest_period(experiments) if model.parts else 0.0)
        unknowns = [
            Unknown(spec.name, spec.unit, slot, lower, upper, 1.0, logarithmic=True)
            for slot, (spec, lower, upper) in enumerate(zip(SPECS, *bounds))
        ]
        scale = (
            max(
                float(np.ptp(experiment.measured[experiment.fitted])) if np.any(experiment.fitted) else 0.0
                for experiment in experiments
            )
            or 1.0
        )
        effects = [self.effects[name] for name in model.parts]
        # effects that shift the resting pressure settle before the first sample, so that the start has no influence
        anywhere = any(effect.rests_anywhere for effect in effects) and not any(effect.moves_rest for effect in effects)
        for index in sorted({experiment.index for experiment in experiments}):
            offset, start, drift = self.recording_slots(index)
            of_recording = [experiment for experiment in experiments if experiment.index == index]
            unknowns.append(Unknown('', 'Pa', offset, -np.inf, np.inf, scale))
            if any(
                experiment.starts_with_recording and (anywhere or not experiment.starts_at_rest)
                for experiment in of_recording
            ):
                # the first samples hardly determine the start of a quick regulator
                farthest = LARGEST_START_DISTANCE * scale
                unknowns.append(Unknown('', 'Pa', start, -farthest, farthest, scale, passing=True))
            if any(experiment.drifts for experiment in of_recording):
                duration = max(float(np.ptp(experiment.times)) for experiment in of_recording)
                unknowns.append(Unknown('', 'Pa/s', drift, -np.inf, np.inf, scale / duration))
        return unknowns

    def held(self, experiments: Sequence[Experiment], model: Model) -> Mapping[str, str]:
        """Return why the lag of a curve, or parameters of a core at a single set-point, are held."""
        levels = np.concatenate([_acting_setpoint(experiment, model)[experiment.counts] for experiment in experiments])
        reasons = dict.fromkeys(model.assumed_parameters, NOT_ESTIMATED)
        if CURVE in model.effects and not is_of_flow(model.effects[CURVE]):
            reasons[f'{CURVE}.lag'] = 'the curve does not depend on the flow'
        if levels.size and float(np.max(levels)) >= LEAST_LEVEL_RATIO * float(np.min(levels)):
            return reasons
        reason = 'not determined at a single set-point; the data-sheet value is used'
        return reasons | {
            f'{core}.{parameter.name}': reason
            for core in model.core
            for parameter in self.effects[core].parameters
            if parameter.of_pressure
        }

    def check(
        self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model, estimates: Sequence[Estimate]
    ) -> None:
        """Raise InputError if a constant pressure explains the measured pressure as well as the model."""
        if any(estimate.identifiable for estimate in estimates) and (
            any(np.ptp(experiment.inputs['setpoint']) > 0.0 for experiment in experiments)
            or _log_likelihood_gain(experiments, simulated) >= LEAST_PISTON_EVIDENCE
        ):
            return
        if not any(np.ptp(experiment.inputs['displacement']) for experiment in experiments):
            raise InputError(
                'these recordings determine no parameter: the piston rests, and the pressure does not follow the '
                'set-point. Check which set-point and pressure belong together, their units, and whether the regulator '
                'has air. Or record the displacement'
            )
        raise InputError(
            'these recordings determine no parameter: the pressure does not follow the piston. Let the piston move '
            'faster or farther, in both directions. Or check whether the filter or the clock of its sensor delays the '
            'displacement'
        )

    def simulated_pieces(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int
    ) -> Iterator[tuple[slice, Array]]:
        """Yield simulated pressures in pieces: exact without effects, by Runge-Kutta with effects."""
        if not effects:
            for parts in zip(*(self._exact_pieces(experiment, row, count, slopes=False) for row in rows)):
                yield parts[0][0], np.column_stack([pressure for _, pressure, _ in parts])
            return
        for block, _, pressures in self._pieces_with_effects(experiment, effects, rows, count, rows):
            yield block.samples, pressures

    def linearised(
        self, experiment: Experiment, effects: Sequence[str], row: Array, slots: Indices, steps: Array, count: int
    ) -> Iterator[tuple[slice, Array, Array]]:
        """
        Yield the pressure and its derivatives in pieces; without effects they are exact.

        The derivative by a delay of the reading is minus the slope of the pressure. The derivative by a drift is the
        derivative by the offset times the time. Neither needs a further simulation.
        """
        if effects:
            late, drift = np.isin(slots, self._delay_slots(effects)[0]), slots == self.shared + _DRIFT
            stepping = ~(late | drift)
            rows = stepped(row, slots[stepping], steps[stepping])
            for block, course, pressures in self._pieces_with_effects(experiment, effects, rows, count, row[None]):
                jacobian = np.empty((len(pressures), slots.size), order='F')
                jacobian[:, stepping] = differences(pressures, steps[stepping])
                jacobian[:, late] = -_slope(block.times, course)[block.sample_indices]
                by_offset = jacobian[:, slots == self.shared + _OFFSET]
                jacobian[:, drift] = _drift_time(experiment, block.times)[block.sample_indices, None] * by_offset
                yield block.samples, pressures[:, 0], jacobian
            return
        columns = np.where(slots < self.shared, slots, slots - self.shared + len(SPECS))
        for samples, pressure, jacobian in self._exact_pieces(experiment, row, count, slopes=True):
            yield samples, pressure, jacobian[:, columns]

    def _exact_pieces(
        self, experiment: Experiment, row: Array, count: int, *, slopes: bool
    ) -> Iterator[tuple[slice, Array, Array]]:
        """Yield the exact pressure and its derivatives by gains, offset, start and drift, in pieces."""
        offset, drift = row[self.shared + _OFFSET], row[self.shared + _DRIFT]
        start_setpoint = (
            experiment.inputs['setpoint'][0] + offset + drift * _drift_time(experiment, experiment.times[0])
        )
        start = start_setpoint + self._start_offsets(experiment, row[None])[0]
        course = Course(row[: len(SPECS)], start)
        for block in experiment.blocks(count):
            drift_time = _drift_time(experiment, block.times)
            displacement = block.inputs['displacement']
            setpoint = block.inputs['setpoint'] + offset + drift * drift_time
            pressure, jacobian = course.simulate_piece(block.times, displacement, setpoint, slopes=slopes)
            if slopes and not experiment.starts_with_recording:
                # the start is measured and does not depend on the offset
                jacobian[:, _OF_OFFSET] -= jacobian[:, _OF_START]
            if slopes and experiment.drifts:
                jacobian = np.column_stack([jacobian, drift_time * jacobian[:, _OF_OFFSET]])
            yield block.samples, pressure[block.sample_indices], jacobian[block.sample_indices] if slopes else jacobian

    def _pieces_with_effects(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int, stiffness_rows: Array
    ) -> Iterator[tuple[Block, Array, Array]]:
        """
        Yield blocks, the pressure of the first row on the block's grid, shape (n, 1), and all rows at the samples.

        Rows with equal delays and drift are simulated side by side. Steps are short enough for the stiffest of the
        `stiffness_rows`, from which the remaining rows hardly differ. If an effect changes the chamber's motion or its
        time, no step is longer than a straight line of the displacement.
        """
        cylinders = self._cylinders(effects, stiffness_rows)
        stiffness = _stiffness(experiment, cylinders)
        at_rest = experiment.starts_with_recording and experiment.starts_at_rest
        settles = at_rest and any(self.effects[name].moves_rest for name in effects)
        delay_slots = self._delay_slots(effects)
        parameters, starts = rows[:, : self.shared].copy(), self._start_offsets(experiment, rows)
        parameters[:, delay_slots[1]] = 0.0  # the blocks hold the delayed displacement
        individual_inputs = np.column_stack(
            [*(rows[:, columns].sum(axis=1) for columns in delay_slots), rows[:, self.shared + _DRIFT]]
        )
        distinct_inputs = dict.fromkeys(map(tuple, individual_inputs.tolist()))
        groups = [np.flatnonzero(np.all(individual_inputs == inputs, axis=1)) for inputs in distinct_inputs]
        is_moved = any(name in MOVING or self.effects[name].late in _LATE_MOTION for name in effects)
        simulated_experiment = (None if is_moved else experiment.parabolic) or experiment
        piece_iterators = []
        for group in groups:
            side_by_side = SideBySide(
                cylinders[0],
                parameters[group],
                rows[group, self.shared],
                starts[group],
                experiment.begin,
                stiffness,
                settles,
            )
            *delays, drift = individual_inputs[group[0]].tolist()
            blocks = simulated_experiment.blocks(count, *delays)
            piece_iterators.append(_pressure_pieces(side_by_side, _with_drift(simulated_experiment, blocks, drift)))
        order = np.argsort(np.concatenate(groups))
        for parts in zip(*piece_iterators):
            first_block, course = parts[0]
            readings_of_groups = [readings[block.sample_indices] for block, readings in parts]
            yield (
                first_block,
                course[:, :1],
                readings_of_groups[0] if len(readings_of_groups) == 1 else np.hstack(readings_of_groups)[:, order],
            )

    def effort(self, experiment: Experiment, effects: Sequence[str], row: Array, models: int, count: int) -> float:
        """Return the effort: equations of flow cost three times those of an effect, and curves twice."""
        if not effects:
            return EXACT_EFFORT * count
        grid = experiment.parabolic or experiment
        stiffness = _stiffness(experiment, self._cylinders(effects, row[None]))
        mean_step = float(grid.times[-1] - grid.times[0]) / max(grid.times.size - 1, 1)
        points = grid.times.size * count / experiment.part.size
        weight = 1.0 + PHYSICAL_EFFORT * any(name in self.cores for name in effects) + CURVE_EFFORT * (CURVE in effects)
        return weight * points * max(mean_step * stiffness, 1.0) * math.ceil(models / COUNT)

    def _cylinders(self, effects: Sequence[str], rows: Array) -> list[ExtendedCylinder]:
        """Return the cylinder of each row."""
        return [
            ExtendedCylinder(
                row[: len(SPECS)],
                {name: row[list(self.slots_of(name))].tolist() for name in effects},
                self.ambient_pressure,
            )
            for row in rows
        ]

    def _delay_slots(self, effects: Sequence[str]) -> list[list[int]]:
        """Return the slots of the delays of the reading, of the displacement, and of the set-point."""
        return [[self.slots_of(name)[0] for name in effects if self.effects[name].late == target] for target in _LATE]

    def _start_offsets(self, experiment: Experiment, rows: Array) -> Array:
        """Return the first pressure minus the set-point, shape (models,) [Pa]."""
        offsets, starts, drifts = rows[:, self.shared :].T
        if experiment.starts_with_recording:
            return np.asarray(starts)
        drift_time = _drift_time(experiment, experiment.times[0])
        return np.asarray(experiment.first_value - experiment.inputs['setpoint'][0] - offsets - drifts * drift_time)

    def may_tell(self, experiments: Sequence[Experiment], effect: str, model: Model) -> bool:
        """Return whether experiments have recorded steps of the set-point, if an effect needs such steps."""
        return not self.effects[effect].is_of_command or any(
            np.ptp(experiment.inputs['setpoint']) > 0.0 for experiment in experiments
        )

    def levels(self, experiments: Sequence[Experiment], model: Model) -> list[Array]:
        """Return the gauge set-point at the samples of each experiment [Pa]."""
        return [_acting_setpoint(experiment, model) - self.ambient_pressure for experiment in experiments]

    def sensitivity(self, model: Model) -> float:
        """Return K_x [Pa/m]."""
        return displacement_sensitivity(model.parameters)

    def rests(self, experiment: Experiment, residual: Array) -> list[Array]:
        """Return the runs of the residual while displacement and set-point rest."""
        displacement, setpoint = experiment.at_samples('displacement'), experiment.at_samples('setpoint')
        slack = SLACK_AT_REST * experiment.motion.noise
        return runs_at_rest(experiment.sample_times, displacement, setpoint, slack, residual)

    def noise(self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model) -> Noise:
        """Return the noise, with the blur by errors of the rate if an effect looks ahead of the displacement."""
        ahead = sum(values[0] for name, values in model.parts.items() if self.effects[name].looks_ahead)
        rate_sensitivity = self.sensitivity(model) * ahead
        blurs = [(rate_sensitivity * experiment.motion.rate_uncertainty) ** 2 for experiment in experiments]
        sizes = [experiment.measured.size for experiment in experiments]
        noise = super().noise(experiments, simulated, model)
        return replace(noise, blur=math.sqrt(float(np.average(blurs, weights=sizes))))

    def precision(self, experiment: Experiment, simulated: Array) -> Array:
        """
        Return the inverse of each sample's standard deviation, relative to a sample at rest.

        While the pressure changes fast, the jitter of its stamp adds to the sensor's noise. After a step of the
        set-point it changes by 10 kPa in a few milliseconds: 50 microseconds of jitter are many times the noise.
        """
        times, before_test = experiment.sample_times, experiment.fitted  # the test part must not influence weights
        before_test = before_test if np.count_nonzero(before_test) >= FEWEST_SAMPLES else ~before_test
        noise, jitter = sample_noise(times[before_test], experiment.measured[before_test]), stamp_jitter(times)
        if noise == 0.0 or jitter == 0.0:
            return np.ones_like(simulated)
        slope = np.abs(np.diff(simulated) / np.diff(times)) * (jitter / noise)
        jitter_ratio = np.zeros_like(simulated)
        jitter_ratio[1:] = slope
        np.maximum(jitter_ratio[:-1], slope, out=jitter_ratio[:-1])
        return np.asarray((1.0 + jitter_ratio**2) ** -0.5)

    def variables(self, experiment: Experiment, simulated: Array, model: Model) -> Mapping[str, Array]:
        """Return the variables of a characteristic; the model's lag gives the valve error, its stiffness the flow."""
        times = experiment.sample_times
        x = experiment.at_samples('displacement')
        rate, slope = np.gradient(x, times), np.gradient(simulated, times)
        k_x, _, _, tau = model.parameters.tolist()
        return {
            'x': x,
            'speed': rate,
            'p': simulated - self.ambient_pressure,
            'error': _acting_setpoint(experiment, model) - simulated + tau * slope,
            'flow': slope + k_x * rate,
            'time': times - experiment.begin,
        }

    def characteristic_units(
        self, experiments: Sequence[Experiment], model: Model, noise: float, most: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Return a small height of an unknown curve for each place: like the noise, or 1 % for factors."""
        rate = float(model.parameters[1]) * noise
        leaks = dict.fromkeys(('leak', *ONE_WAY), rate / most['p'])
        shares = dict.fromkeys(('flow', 'gain', 'stiffness'), 1e-2)
        return {**shares, **leaks, 'set_point': noise, 'chamber': rate, 'sensing': noise}

    def regressors(self, experiment: Experiment, simulated: Array, weight: Array) -> Regressors:
        """Return inputs, simulated signals and products as regressors."""
        times = experiment.sample_times
        x, setpoint = experiment.at_samples('displacement'), experiment.at_samples('setpoint')
        # rates use a smoothed period: jitter of the stamps would look like a dependence on the rate
        period = uniform_filter1d(np.gradient(times), _SMOOTHED, mode='nearest')
        rate = np.gradient(x) / period
        error = setpoint - simulated
        change = np.gradient(simulated) / period
        progress = 2.0 * (times - times[0]) / (times[-1] - times[0]) - 1.0
        centred = (x - np.mean(x)) / max(float(np.std(x)), 1e-12)
        level = setpoint - np.mean(setpoint)
        moving = np.sign(rate) * (np.abs(rate) > 0.05 * np.std(rate))
        lagged = [rate, change, error, np.abs(error), np.abs(rate), moving]
        once = [x, level, centred * rate, centred * error, level * error, progress * change, progress * rate, x * x]
        once += [level * level, np.abs(change), error * np.abs(error)]
        return Regressors(once, lagged, weight, int(np.argmax(experiment.counts)))

    def data(self, experiments: Sequence[Experiment], model: Model, simulated: Sequence[Array]) -> Data:
        """
        Return the features for the effects' starting values.

        - `k_x` and so on: gains as fitted
        - `residual`, `mean` [Pa]: root mean square and mean of the residual
        - `gauge`, `level` [Pa]: median gauge pressure, mean absolute pressure
        - `highest_pressure` [Pa]: highest absolute pressure
        - `x_low`, `x_high` [m]: range of the displacement
        - `speed` [m/s]: root mean square of the piston's speed in motion
        - `lag` [s]: delay of the measured behind the simulated pressure
        - `setpoint_lag` [s]: delay of the measured behind the simulated pressure after steps of the set-point, or half
          of the delay in the model: a dead time and a lag share what one of them alone explains
        - `period`, `duration` [s]: shortest sampling period, duration of the longest experiment
        - `largest_charge`, `largest_exhaust` [Pa/s]: largest flow of the valves
        - `slow_frequency` [Hz]: strongest frequency of the residual below 3 Hz
        """
        residuals = [experiment.measured - pressure for experiment, pressure in zip(experiments, simulated)]
        pressures, residual = (
            np.concatenate(runs) for runs in ([experiment.measured for experiment in experiments], residuals)
        )
        displacement = np.concatenate([experiment.inputs['displacement'] for experiment in experiments])
        errors = [
            _acting_setpoint(experiment, model) - pressure for experiment, pressure in zip(experiments, simulated)
        ]
        charge, exhaust = flows(model.parameters, np.concatenate(errors))
        rank = max(range(len(experiments)), key=lambda index: float(np.ptp(experiments[index].sample_times)))
        longest = experiments[rank]
        return {
            **dict(zip(self.parameters, model.parameters.tolist())),
            'residual': rms(residual),
            'mean': float(np.mean(residual)),
            'gauge': max(float(np.median(pressures)) - self.ambient_pressure, 1e3),
            'level': float(np.mean(pressures)),
            'highest_pressure': float(np.max(pressures)),
            'x_low': float(np.min(displacement)),
            'x_high': max(float(np.max(displacement)), float(np.min(displacement)) + SHORTEST_STROKE),
            'speed': speed_in_motion(longest.times, longest.inputs['displacement']),
            'lag': lag_between(longest.sample_times, longest.measured, simulated[rank]),
            'setpoint_lag': max(
                lag_after_steps(
                    [experiment.sample_times for experiment in experiments],
                    [experiment.at_samples('setpoint') for experiment in experiments],
                    residuals,
                ),
                0.5 * sum(values[0] for name, values in model.effects.items() if self.effects[name].is_of_command),
            ),
            'period': shortest_period(experiments),
            'duration': float(np.ptp(longest.sample_times)),
            'largest_charge': max(charge, LEAST_FLOW_LIMIT),
            'largest_exhaust': max(exhaust, LEAST_FLOW_LIMIT),
            'slow_frequency': strongest_frequency(longest.sample_times, residuals[rank]),
        }

    def shown(self, experiment: Experiment) -> Mapping[str, Array]:
        """Return displacement, speed and set-point."""
        displacement = experiment.at_samples('displacement')
        return {
            'displacement': displacement,
            'piston speed': np.gradient(displacement, experiment.sample_times),
            'set-point': experiment.at_samples('setpoint'),
        }


def _stiffness(experiment: Experiment, cylinders: Sequence[ExtendedCylinder]) -> float:
    """Return the inverse of the longest step at which all cylinders are simulated [1/s]."""
    stiffest = max(cylinder.stiffness(*experiment.extremes) for cylinder in cylinders)
    return min(stiffest, LARGEST_RATE_PER_SAMPLE / experiment.period)


def _acting_setpoint(experiment: Experiment, model: Model) -> Array:
    """Return the acting set-point at the samples, shape (m,) [Pa]."""
    offset, _, drift = model.recording_values[experiment.index].tolist()
    setpoint: Array = (
        experiment.at_samples('setpoint') + offset + drift * _drift_time(experiment, experiment.sample_times)
    )
    return setpoint


def _drift_time(experiment: Experiment, times: Array) -> Array:
    """Return the time for which a set-point has drifted, shape (n,) [s]."""
    return np.asarray(times - experiment.begin)


def _with_drift(experiment: Experiment, blocks: Iterator[Block], drift: float) -> Iterator[Block]:
    """Yield pieces of an experiment with a drift added to the set-point [Pa/s]."""
    for block in blocks:
        if drift:
            setpoint = block.inputs['setpoint'] + drift * _drift_time(experiment, block.times)
            block = block._replace(inputs={**block.inputs, 'setpoint': setpoint})
        yield block


def _pressure_pieces(cylinders: SideBySide, blocks: Iterator[Block]) -> Iterator[tuple[Block, Array]]:
    """Yield pieces of an experiment with the pressures of cylinders on its grid, shape (n, cylinders) [Pa]."""
    for block in blocks:
        yield block, cylinders.simulate_piece(block.times, **block.inputs)


def _log_likelihood_gain(experiments: Sequence[Experiment], simulated: Sequence[Array]) -> float:
    """Return the gain of twice the log likelihood by the simulation, compared with a constant pressure."""
    gain = 0.0
    for experiment, pressure in zip(experiments, simulated):
        mask = experiment.counts
        if np.any(mask):
            variance = float(np.var(experiment.measured[mask]))
            unexplained = float(np.mean((experiment.measured - pressure)[mask] ** 2))
            gain += np.count_nonzero(mask) * math.log(variance / max(unexplained, 1e-300))
    return gain


def _slope(times: Array, values: Array) -> Array:
    """Return the rate of change of values, from differences of adjacent values, shape (n, 1) [SI/s]."""
    indices = np.arange(times.size)
    before, after = np.maximum(indices - 1, 0), np.minimum(indices + 1, times.size - 1)
    durations = np.maximum(times[after] - times[before], SHORTEST_GAP)
    return np.asarray((values[after] - values[before]) / durations[:, None])
