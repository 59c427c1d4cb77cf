# SPDX-License-Identifier: Apache-2.0
"""A cylinder's pressure: equations (8) and (12) of the paper, exactly where no effect is on."""

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
    displacement_sensitivity,
    flows,
    is_of_flow,
    other_gains,
    starting_gains,
    told_gains,
)
from cfd_pneumatic.model import CURVE_AGAINST as AGAINST
from cfd_pneumatic.model import CURVE_ENTERS as ENTERS
from cfd_pneumatic.recording import Recording, Signal
from cfd_pneumatic.units import PSI

_LARGEST = 1e9  # [Pa]
_SMOOTHED = 25  # samples
_LEAST_FLOW = 10.0  # that a limit may be drawn from [Pa/s]
_LEAST_EVIDENCE = 40.0  # by which following the piston must raise twice the log likelihood; noise alone stays below
_MOST_STEPS = 100.0  # in a sample: what is quicker runs away in them, and no search goes there
_LINEARISED = 1.5  # periods: where small changes are asked for, by which a quicker model differs hardly
_SENSED = 0.03  # after which a sensed pressure that is not known at the start is forgotten [s]
_SHORTEST_GAP = 1e-9  # [s]
_SHORTEST_STROKE = 1e-5  # that effects along the stroke are tried over, whatever the piston does [m]
_APART = 1.01  # times the lowest set-point: where they are nearer, no dependence on the pressure is told
_FARTHEST = 3.0  # times what a pressure spans, that it begins from its set-point at most
_FLOW_LAGS = (0.03, 0.1, 0.3)  # of the flow that a law depends on [s]
_SLACK = 6.0  # standard deviations of the displacement's noise by which it may stray at rest
_OFFSET, _START, _DRIFT = range(3)
_OF_OFFSET, _OF_START = len(SPECS), len(SPECS) + 1  # columns of the exact derivatives


class Pressure(Channel):
    """
    The pressure of one cylinder.

    Inputs of an experiment: `displacement` that grows this chamber [m], absolute `setpoint` on the step that ends at
    each grid time [Pa]. Each experiment has an `offset` of its set-point, and a `start` of the pressure above it [Pa].
    A set-point that nobody recorded has a `drift`, too: a regulator that is set by hand creeps [Pa/s].
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
            'error': ('flow', 'gain'),  # one at the chamber is one of the flow
            'flow': ('flow', 'set_point'),
            'time': ('set_point', 'flow', 'gain', 'sensing'),
        },
        memory=_FLOW_LAGS[0],
        memories={('flow', 'flow'): _FLOW_LAGS, ('set_point', 'flow'): _FLOW_LAGS},
        both_ways=('speed', 'error', 'flow'),
    )
    parameters = MappingProxyType({spec.name: spec.unit for spec in SPECS})
    hints = HINTS
    own = ('offset', 'start', 'drift')
    needed = True

    def __init__(self, cylinder: str, ambient_pressure: float) -> None:
        self.name = cylinder
        self.topics = pressure_topic(cylinder), pressure_topic(cylinder)
        self.ambient_pressure = ambient_pressure

    @classmethod
    def found_in(cls, recordings: Sequence[Recording], options: Options) -> list[Pressure]:
        """Return one for each cylinder whose pressure was recorded."""
        present = [name for name in CYLINDERS if any(name in recording.cylinders for recording in recordings)]
        return [cls(name, options.ambient_pressure) for name in present]

    def signal(self, recording: Recording) -> Signal | None:
        """Return the cylinder's pressure."""
        signals = recording.cylinders.get(self.name)
        return None if signals is None else signals.pressure

    def experiment(self, recording: Recording, motion: Motion, split: Split) -> Experiment:
        """Return the cylinder in a recording."""
        signals = recording.cylinders[self.name]
        stamped = motion.clock_of(signals.pressure.times)
        during = motion.during(stamped)
        sampled, pressure = stamped[during], signals.pressure.values[during]
        self._check(recording.name, pressure)
        seen = pressure[: np.searchsorted(sampled, split.bounds[1])]
        level = float(np.median(seen if seen.size else pressure))
        times, inputs = self.driven(motion, level if signals.setpoint is None else signals.setpoint, sampled)
        at_rest, part = rests_at_start(motion), split.part_of(sampled)
        known = sampled >= sampled[0] + _SENSED
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
        """Return a grid that holds sample times, shape (n,) [s], and the inputs on it; set-points are absolute [Pa]."""
        changed, levels = motion.times[:1], np.array([setpoint])
        if isinstance(setpoint, Signal):
            changed, levels = motion.on_clock(setpoint.times), setpoint.values
        times, displacement = motion.on_grid(sampled, changed)
        begins = np.append(motion.times[0], times[:-1])
        held = np.searchsorted(changed, begins, side='right') - 1
        return times, {'displacement': DIRECTIONS[self.name] * displacement, 'setpoint': levels[np.maximum(held, 0)]}

    def _check(self, recording: str, pressure: Array) -> None:
        topic = f'{self.name}/pressure'
        if pressure.size < FEWEST_SAMPLES:
            raise InputError(
                f'{recording}: only {pressure.size} samples of {topic} lie between the first and the last '
                'displacement sample: check the time offsets of the two topics'
            )
        if np.ptp(pressure) == 0.0:
            raise InputError(f'{recording}: {topic} never changes ({pressure[0]:g} Pa): is its sensor connected?')
        check_range(f'{recording}: {topic}', pressure, _LARGEST, 'Pa')

    def starts(self, experiments: Sequence[Experiment]) -> list[Model]:
        """Return models of several regulators."""
        pressure = float(np.median(np.concatenate([one.measured[one.counts] for one in experiments])))
        stroke = max(float(np.ptp(one.inputs['displacement'])) for one in experiments)
        own = np.zeros((len(experiments), len(self.own)))
        for one in experiments:
            own[one.index, _START] = 0.0 if one.starts_at_rest else one.first_value - one.inputs['setpoint'][0]
        return [Model(gains, {}, own) for gains in starting_gains(pressure, stroke)]

    def beginnings(self, model: Model, astray: bool) -> list[Model]:
        """Return the model, and with other gains."""
        return [model, *(replace(model, parameters=gains) for gains in other_gains(model.parameters, astray))]

    def beside_effects(self, experiments: Sequence[Experiment], model: Model) -> Model:
        """Return the model, no quicker than small changes tell: Runge and Kutta's steps get as short as it is quick."""
        told = told_gains(_LINEARISED * shortest_period(experiments))
        return replace(model, parameters=np.clip(model.parameters, *told))

    def searched(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return the gains, every offset, and the starts where the piston does not begin at rest."""
        bounds = told_gains(shortest_period(experiments) if model.parts else 0.0)
        found = [
            Unknown(spec.name, spec.unit, slot, lower, upper, 1.0, logarithmic=True)
            for slot, (spec, lower, upper) in enumerate(zip(SPECS, *bounds))
        ]
        scale = (
            max(float(np.ptp(one.measured[one.fitted])) if np.any(one.fitted) else 0.0 for one in experiments) or 1.0
        )
        parts = [self.effects[name] for name in model.parts]
        # what moves the rest settles before the first sample: where it began is forgotten
        anywhere = any(one.rests_anywhere for one in parts) and not any(one.moves_rest for one in parts)
        for index in sorted({one.index for one in experiments}):
            offset, start, drift = self.own_slots(index)
            alike = [one for one in experiments if one.index == index]
            found.append(Unknown('', 'Pa', offset, -np.inf, np.inf, scale))
            if any(one.starts_with_recording and (anywhere or not one.starts_at_rest) for one in alike):
                farthest = _FARTHEST * scale  # of a quick regulator the first samples tell little
                found.append(Unknown('', 'Pa', start, -farthest, farthest, scale, passing=True))
            if any(one.drifts for one in alike):
                lasts = max(float(np.ptp(one.times)) for one in alike)
                found.append(Unknown('', 'Pa/s', drift, -np.inf, np.inf, scale / lasts))
        return found

    def held(self, experiments: Sequence[Experiment], model: Model) -> Mapping[str, str]:
        """Return the lag of a law that has none, and what of a core recordings at one pressure do not tell."""
        levels = np.concatenate([_held(one, model)[one.counts] for one in experiments])
        held = dict.fromkeys(model.untold, NOT_ESTIMATED)
        if CURVE in model.effects and not is_of_flow(model.effects[CURVE]):
            held[f'{CURVE}.lag'] = 'the law is none of the flow'
        if levels.size and float(np.max(levels)) >= _APART * float(np.min(levels)):
            return held
        reason = 'recordings at one set-point do not tell it: it stands as a data sheet has it'
        return held | {
            f'{core}.{one.name}': reason
            for core in model.core
            for one in self.effects[core].parameters
            if one.of_pressure
        }

    def check(
        self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model, estimates: Sequence[Estimate]
    ) -> None:
        """Raise InputError where the pressure is explained as well by one that does not follow the piston at all."""
        if any(estimate.identifiable for estimate in estimates) and (
            any(np.ptp(one.inputs['setpoint']) > 0.0 for one in experiments)
            or _evidence(experiments, simulated) >= _LEAST_EVIDENCE
        ):
            return
        if not any(np.ptp(one.inputs['displacement']) for one in experiments):
            raise InputError(
                'no parameter can be told from these recordings: the piston rests, and the pressure does not follow '
                'the set-point: check which set-point and pressure belong together, their units, and whether the '
                'regulator has air; or record the displacement'
            )
        raise InputError(
            'no parameter can be told from these recordings, the pressure does not follow the piston: let it move '
            "faster or farther, both ways, or look whether the displacement comes late, by its sensor's filter or clock"
        )

    def follow(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int
    ) -> Iterator[tuple[slice, Array]]:
        """Yield the pressures: exactly without effects, by Runge-Kutta with them."""
        if not effects:
            for parts in zip(*(self._exact(experiment, row, count, slopes=False) for row in rows)):
                yield parts[0][0], np.column_stack([pressure for _, pressure, _ in parts])
            return
        for block, _, pressures in self._composed(experiment, effects, rows, count, rows):
            yield block.samples, pressures

    def linearised(
        self, experiment: Experiment, effects: Sequence[str], row: Array, slots: Indices, steps: Array, count: int
    ) -> Iterator[tuple[slice, Array, Array]]:
        """
        Yield the pressure and its derivatives; without effects they are exact.

        Who reads later reads what the pressure was by its slope before: no other simulation is asked for a delay. Nor
        for a drift, which a pressure follows.
        """
        if effects:
            late, drift = np.isin(slots, self._late(effects)[0]), slots == self.shared + _DRIFT
            stepping = ~(late | drift)
            rows = stepped(row, slots[stepping], steps[stepping])
            for block, course, pressures in self._composed(experiment, effects, rows, count, row[None]):
                jacobian = np.empty((len(pressures), slots.size), order='F')
                jacobian[:, stepping] = differences(pressures, steps[stepping])
                jacobian[:, late] = -_slope(block.times, course)[block.sample_indices]
                by_offset = jacobian[:, slots == self.shared + _OFFSET]
                jacobian[:, drift] = _drifted(experiment, block.times)[block.sample_indices, None] * by_offset
                yield block.samples, pressures[:, 0], jacobian
            return
        columns = np.where(slots < self.shared, slots, slots - self.shared + len(SPECS))
        for samples, pressure, jacobian in self._exact(experiment, row, count, slopes=True):
            yield samples, pressure, jacobian[:, columns]

    def _exact(
        self, experiment: Experiment, row: Array, count: int, *, slopes: bool
    ) -> Iterator[tuple[slice, Array, Array]]:
        """Yield pressure and derivatives by the gains, the offset, the start and the drift, which it follows."""
        offset, drift = row[self.shared + _OFFSET], row[self.shared + _DRIFT]
        begun = experiment.inputs['setpoint'][0] + offset + drift * _drifted(experiment, experiment.times[0])
        start = begun + self._starts(experiment, row[None])[0]
        course = Course(row[: len(SPECS)], start)
        for block in experiment.blocks(count):
            since = _drifted(experiment, block.times)
            moved, held = block.inputs['displacement'], block.inputs['setpoint'] + offset + drift * since
            pressure, jacobian = course.follow(block.times, moved, held, slopes=slopes)
            if slopes and not experiment.starts_with_recording:
                jacobian[:, _OF_OFFSET] -= jacobian[:, _OF_START]  # the start is measured, whatever the offset
            if slopes and experiment.drifts:
                jacobian = np.column_stack([jacobian, since * jacobian[:, _OF_OFFSET]])
            yield block.samples, pressure[block.sample_indices], jacobian[block.sample_indices] if slopes else jacobian

    def _composed(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int, unlike: Array
    ) -> Iterator[tuple[Block, Array, Array]]:
        """
        Yield pressures with effects, and that of the first row on the grid of its block, shape (n, 1).

        Cylinders that are read as late, moved as late and drift alike are simulated side by side, in steps short enough
        for the stiffest of the rows that are `unlike`: the others differ hardly from them. Where an effect moves the
        chamber in another way than the piston, or at another time, no step is longer than a straight line.
        """
        cylinders = [
            ExtendedCylinder(
                row[: len(SPECS)],
                {name: row[list(self.slots_of(name))].tolist() for name in effects},
                self.ambient_pressure,
            )
            for row in unlike
        ]
        stiffest = max(one.stiffness(*experiment.extremes) for one in cylinders)
        stiffness = min(stiffest, _MOST_STEPS / experiment.period)
        at_rest = experiment.starts_with_recording and experiment.starts_at_rest
        settles = at_rest and any(self.effects[name].moves_rest for name in effects)
        late = self._late(effects)
        parameters, starts = rows[:, : self.shared].copy(), self._starts(experiment, rows)
        parameters[:, late[1]] = 0.0  # the displacement is looked up
        unlike_inputs = np.column_stack([*(rows[:, some].sum(axis=1) for some in late), rows[:, self.shared + _DRIFT]])
        kinds = dict.fromkeys(map(tuple, unlike_inputs.tolist()))
        groups = [np.flatnonzero(np.all(unlike_inputs == some, axis=1)) for some in kinds]
        is_moved = any(name in MOVING or self.effects[name].late for name in effects)
        followed = (None if is_moved else experiment.parabolic) or experiment
        walks = []
        for own in groups:
            alike = SideBySide(
                cylinders[0], parameters[own], rows[own, self.shared], starts[own], experiment.begin, stiffness, settles
            )
            delay, behind, drift = unlike_inputs[own[0]].tolist()
            walks.append(_walk(alike, _drifting(followed, followed.blocks(count, delay, behind), drift)))
        order = np.argsort(np.concatenate(groups))
        for parts in zip(*walks):
            first, course = parts[0]
            read = [readings[block.sample_indices] for block, readings in parts]
            yield first, course[:, :1], read[0] if len(read) == 1 else np.hstack(read)[:, order]

    def _late(self, effects: Sequence[str]) -> list[list[int]]:
        """Return where parameters stand in a row by which the reading, and the displacement, come late."""
        return [
            [self.slots_of(name)[0] for name in effects if self.effects[name].late == what]
            for what in ('reading', 'displacement')
        ]

    def _starts(self, experiment: Experiment, rows: Array) -> Array:
        """Return by how much models start above the set-point, shape (models,) [Pa]."""
        offsets, starts, drifts = rows[:, self.shared :].T
        if experiment.starts_with_recording:
            return np.asarray(starts)
        drifted = _drifted(experiment, experiment.times[0])
        return np.asarray(experiment.first_value - experiment.inputs['setpoint'][0] - offsets - drifts * drifted)

    def levels(self, experiments: Sequence[Experiment], model: Model) -> list[Array]:
        """Return the gauge set-point."""
        return [_held(one, model) - self.ambient_pressure for one in experiments]

    def sensitivity(self, model: Model) -> float:
        """Return K_x [Pa/m]."""
        return displacement_sensitivity(model.parameters)

    def rests(self, experiment: Experiment, residual: Array) -> list[Array]:
        """Return the runs of the residual while displacement and set-point rest."""
        displacement, setpoint = experiment.at_samples('displacement'), experiment.at_samples('setpoint')
        slack = _SLACK * experiment.motion.noise
        return runs_at_rest(experiment.sample_times, displacement, setpoint, slack, residual)

    def noise(self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model) -> Noise:
        """Return the noise, blurred by the rate of the displacement if that is made to run ahead."""
        ahead = sum(values[0] for name, values in model.parts.items() if self.effects[name].looks_ahead)
        rate_sensitivity = self.sensitivity(model) * ahead
        blurs = [(rate_sensitivity * one.motion.rate_uncertainty) ** 2 for one in experiments]
        sizes = [one.measured.size for one in experiments]
        noise = super().noise(experiments, simulated, model)
        return replace(noise, blur=math.sqrt(float(np.average(blurs, weights=sizes))))

    def precision(self, experiment: Experiment, simulated: Array) -> Array:
        """
        Return the inverse of each sample's standard deviation, relative to a sample at rest.

        While the pressure changes fast, the jitter of its stamp counts beside the sensor's noise: a step of the
        set-point makes 10 kPa in a few milliseconds, and 50 microseconds of it are many times the noise.
        """
        times, seen = experiment.sample_times, experiment.fitted  # the test part has no say in what samples weigh
        seen = seen if np.count_nonzero(seen) >= FEWEST_SAMPLES else ~seen
        noise, jitter = sample_noise(times[seen], experiment.measured[seen]), stamp_jitter(times)
        if noise == 0.0 or jitter == 0.0:
            return np.ones_like(simulated)
        slope = np.abs(np.diff(simulated) / np.diff(times)) * (jitter / noise)
        strayed = np.zeros_like(simulated)
        strayed[1:] = slope
        np.maximum(strayed[:-1], slope, out=strayed[:-1])
        return np.asarray((1.0 + strayed**2) ** -0.5)

    def variables(self, experiment: Experiment, simulated: Array, model: Model) -> Mapping[str, Array]:
        """Return what a law may depend on: what is sensed follows from the model's lag, the flow from its stiffness."""
        times = experiment.sample_times
        x = experiment.at_samples('displacement')
        rate, slope = np.gradient(x, times), np.gradient(simulated, times)
        k_x, _, _, tau = model.parameters.tolist()
        return {
            'x': x,
            'speed': rate,
            'p': simulated - self.ambient_pressure,
            'error': _held(experiment, model) - simulated + tau * slope,
            'flow': slope + k_x * rate,
            'time': times - experiment.begin,
        }

    def law_units(
        self, experiments: Sequence[Experiment], model: Model, noise: float, most: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Return the noise's size, a hundredth of what is scaled, and what the valves make of the noise."""
        rate = float(model.parameters[1]) * noise
        leaks = dict.fromkeys(('leak', *ONE_WAY), rate / most['p'])
        shares = dict.fromkeys(('flow', 'gain', 'stiffness'), 1e-2)
        return {**shares, **leaks, 'set_point': noise, 'chamber': rate, 'sensing': noise}

    def regressors(self, experiment: Experiment, simulated: Array, weight: Array) -> Regressors:
        """Return inputs, what the model makes of them, and their products."""
        times = experiment.sample_times
        x, setpoint = experiment.at_samples('displacement'), experiment.at_samples('setpoint')
        # by a smoothed period: the stamps' jitter in a rate would pass for a dependence on it
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
        Return what effects draw their starting values from.

        =====================  ============================================================
        `k_x` and so on        gains as fitted
        `residual`, `mean` [Pa]  root mean square and mean of the residual
        `gauge` [Pa]           median gauge pressure
        `highest_pressure` [Pa]  absolute
        `x_low`, `x_high` [m]  range of the displacement
        `speed` [m/s]          root mean square of the piston's, while it moves
        `lag` [s]              by which the measured pressure comes later than the simulated one
        `period`, `duration` [s]  between samples, and of the longest experiment
        `largest_charge`, `largest_exhaust` [Pa/s]  what the valves' flow reaches
        `slow_frequency` [Hz]  strongest period of the residual below 3 Hz
        =====================  ============================================================
        """
        residuals = [one.measured - pressure for one, pressure in zip(experiments, simulated)]
        pressures, left = (np.concatenate(runs) for runs in ([one.measured for one in experiments], residuals))
        displacement = np.concatenate([one.inputs['displacement'] for one in experiments])
        errors = [_held(one, model) - pressure for one, pressure in zip(experiments, simulated)]
        charge, exhaust = flows(model.parameters, np.concatenate(errors))
        longest = max(range(len(experiments)), key=lambda index: float(np.ptp(experiments[index].sample_times)))
        one = experiments[longest]
        return {
            **dict(zip(self.parameters, model.parameters.tolist())),
            'residual': rms(left),
            'mean': float(np.mean(left)),
            'gauge': max(float(np.median(pressures)) - self.ambient_pressure, 1e3),
            'level': float(np.mean(pressures)),
            'highest_pressure': float(np.max(pressures)),
            'x_low': float(np.min(displacement)),
            'x_high': max(float(np.max(displacement)), float(np.min(displacement)) + _SHORTEST_STROKE),
            'speed': speed_in_motion(one.times, one.inputs['displacement']),
            'lag': lag_between(one.sample_times, one.measured, simulated[longest]),
            'period': shortest_period(experiments),
            'duration': float(np.ptp(one.sample_times)),
            'largest_charge': max(charge, _LEAST_FLOW),
            'largest_exhaust': max(exhaust, _LEAST_FLOW),
            'slow_frequency': strongest_frequency(one.sample_times, residuals[longest]),
        }

    def shown(self, experiment: Experiment) -> Mapping[str, Array]:
        """Return displacement, speed and set-point."""
        displacement = experiment.at_samples('displacement')
        return {
            'displacement': displacement,
            'piston speed': np.gradient(displacement, experiment.sample_times),
            'set-point': experiment.at_samples('setpoint'),
        }


def _held(experiment: Experiment, model: Model) -> Array:
    """Return the set-point that acts at the samples, shape (m,) [Pa]."""
    offset, _, drift = model.own[experiment.index].tolist()
    held: Array = experiment.at_samples('setpoint') + offset + drift * _drifted(experiment, experiment.sample_times)
    return held


def _drifted(experiment: Experiment, times: Array) -> Array:
    """Return for how long a set-point has drifted [s]."""
    return np.asarray(times - experiment.begin)


def _drifting(experiment: Experiment, blocks: Iterator[Block], drift: float) -> Iterator[Block]:
    """Yield pieces of an experiment with a set-point that drifts [Pa/s]."""
    for block in blocks:
        if drift:
            setpoint = block.inputs['setpoint'] + drift * _drifted(experiment, block.times)
            block = block._replace(inputs={**block.inputs, 'setpoint': setpoint})
        yield block


def _walk(cylinders: SideBySide, blocks: Iterator[Block]) -> Iterator[tuple[Block, Array]]:
    """Yield the pressures of cylinders side by side in pieces of an experiment, on its grid."""
    for block in blocks:
        yield block, cylinders.follow(block.times, **block.inputs)


def _evidence(experiments: Sequence[Experiment], simulated: Sequence[Array]) -> float:
    """Return by how much following the piston raises twice the log likelihood of a pressure that rests."""
    evidence = 0.0
    for one, pressure in zip(experiments, simulated):
        mask = one.counts
        if np.any(mask):
            rested, left = float(np.var(one.measured[mask])), float(np.mean((one.measured - pressure)[mask] ** 2))
            evidence += np.count_nonzero(mask) * math.log(rested / max(left, 1e-300))
    return evidence


def _slope(times: Array, values: Array) -> Array:
    """Return how fast values change, from each one's neighbours, shape (n, 1) [SI/s]."""
    at = np.arange(times.size)
    before, after = np.maximum(at - 1, 0), np.minimum(at + 1, times.size - 1)
    between = np.maximum(times[after] - times[before], _SHORTEST_GAP)
    return np.asarray((values[after] - values[before]) / between[:, None])
