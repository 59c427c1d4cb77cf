# SPDX-License-Identifier: Apache-2.0
"""The watch over a device: its model beside it, the charts, the topics' faults, and what the loop makes of an alarm."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import NamedTuple

from cfd_pneumatic import convention
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.model import Arrival, DeviceModel, LiveDevice
from cfd_pneumatic.monitoring.feed import Clock, Fault, Sensor
from cfd_pneumatic.monitoring.finding import Finding, News, news
from cfd_pneumatic.monitoring.watched_signal import Departure, WatchedSignal
from cfd_pneumatic.monitoring.window import Window
from cfd_pneumatic.recording import Recording

_SETTLING = 1.0  # after which a model has forgotten where it started, and a device that it was another [s]
_LINGER = {'silent': 5.0, 'clock': 5.0, 'stuck': 1.0}  # how long a fault is told of after it was seen last [s]
_PENDING = 5000  # measured values that wait for the displacement, at most
_AGITATED = 3.0  # standard deviation of pressures that move while the displacement does not, over the noise
_SHARE_TO_DIAGNOSE = 1.0 / 3.0  # of the window that lies behind a change before the loop is closed, and closed again

Ask = Callable[[Recording], 'Future[Finding]']
"""Has the loop closed on a recording, elsewhere."""


@dataclass(frozen=True)
class Settings:
    """
    How to watch.

    Attributes
    ----------
    mean_time
        Mean time between false alarms [s].
    learning
        How long is learned what is usual [s].
    window
        How long a diagnosis looks back [s].
    block
        Over which residuals are averaged [s].
    timeout
        Silence that is a fault [s].
    max_gap
        Longest time between samples that is no gap [s].
    pressure_tolerance, force_tolerance
        How far the mean residual may stray for a lasting time [Pa, N]; None: as far as it does while learning.

    """

    mean_time: float = 86_400.0
    learning: float = 300.0
    window: float = 60.0
    block: float = 0.2
    timeout: float = 0.5
    max_gap: float = 1.0
    pressure_tolerance: float | None = None
    force_tolerance: float | None = None


class Prediction(NamedTuple):
    """What the model says at a sample of the piston."""

    stamp: int
    """Of the sample [ns]."""

    values: tuple[float, ...]
    """Of the cylinders' pressures [Pa] and of the contact force [N]."""

    rates: tuple[float, ...]
    """By which they have changed since the sample before [Pa/s, N/s]."""


class Residual(NamedTuple):
    """Measured less predicted."""

    channel: str
    """`cylinder_a`, `cylinder_b` or `contact_force`."""

    stamp: int
    """Of the measured value [ns]."""

    value: float
    """[Pa or N]."""


class _Line:
    """One measured topic: its stamps, its sensor, and its channel."""

    def __init__(self, index: int, topic: str, unit: str, channel: WatchedSignal, settings: Settings) -> None:
        self.index = index
        self.topic = topic
        self.channel = channel
        self.clock = Clock(topic, settings.max_gap)
        self.sensor = Sensor(topic, unit)
        self.pending: deque[tuple[int, float]] = deque(maxlen=_PENDING)
        self.hold = 0
        self.block = -1

    def restart(self) -> None:
        """Begin anew behind a break."""
        self.channel.restart()
        self.sensor.restart()
        self.pending.clear()


@dataclass
class Alarm:
    """
    A signal that has parted from its model.

    Attributes
    ----------
    since
        Stamp from which on [ns].
    level
        Whether the mean has moved; otherwise the residual has become larger about it.
    rung
        Stamps of the first and of the last time that a chart rang [ns].
    diagnosed
        Stamp up to which the loop was closed on it, or 0 [ns].
    news
        What is new in what the loop ended with, or None.
    failure
        Why the loop could not be closed, or None.

    """

    since: int
    level: bool
    rung: tuple[int, int]
    diagnosed: int = 0
    news: News | None = None
    failure: str | None = None


class _Asked(NamedTuple):
    """A diagnosis that is being made."""

    answer: Future[Finding]
    """What comes of it."""

    end: int
    """Stamp up to which it looks [ns]."""

    breaks: int
    """How often the feed had broken before: what has broken since makes it worthless."""

    reference: bool
    """Whether it is of the device as it should be."""


class Watch:
    """
    A device watched beside its model.

    Times are of two kinds: stamps of messages [ns], and a steady time at which they are heard [s].

    Parameters
    ----------
    device
        The model.
    settings
        How to watch.
    ask
        Closes the loop on a recording.
    supply
        Absolute pressure that none can exceed [Pa].

    """

    def __init__(self, device: DeviceModel, settings: Settings, ask: Ask, supply: float = math.inf) -> None:
        self.settings = settings
        self.alarms: dict[str, Alarm] = {}
        self._ask = ask
        self._live = LiveDevice(device, settings.max_gap, supply)
        self._cylinders = tuple(device.cylinders)
        self._predictions: deque[Prediction] = deque()
        self._window = Window(settings.window)
        self._piston_clock = Clock(convention.PISTON_STATE, settings.max_gap)
        self._piston_sensor = Sensor(convention.PISTON_STATE, 'm')
        self._setpoints: tuple[float, ...] | None = None
        self._setpoints_changed = 0
        self._faults: dict[str, tuple[Fault, float]] = {}
        self._lines = self._make_lines()
        self._breaks = 0
        self._pending: _Asked | None = None
        self._reference: Finding | None = None
        self._reference_tried = 0  # stamp up to which the last try looked [ns]

    def _make_lines(self) -> dict[str, _Line]:
        settings = self.settings
        lines = {}
        for index, name in enumerate((*self._cylinders, convention.CONTACT_FORCE)):
            is_force = name == convention.CONTACT_FORCE
            channel = WatchedSignal(
                name,
                round(settings.learning / settings.block),
                round(settings.block * NANOSECONDS),
                settings.mean_time / settings.block,
                settings.force_tolerance if is_force else settings.pressure_tolerance,
            )
            topic = convention.MEASURED_FORCE if is_force else convention.pressure_topic(name)
            lines[name] = _Line(index, topic, 'N' if is_force else 'Pa', channel, settings)
        return lines

    # what is heard

    def piston(self, stamp: int, position: float, setpoints: tuple[float, float], now: float) -> Prediction | Arrival:
        """
        Take a sample of the piston.

        Parameters
        ----------
        stamp
            Of the sample [ns].
        position
            Piston displacement [m].
        setpoints
            Absolute set-points of A and B that acted up to it [Pa].
        now
            Steady time [s].

        Returns
        -------
        Prediction or Arrival
            Why there is none: the stamp is repeated, or a pressure would be impossible.

        """
        before = self._live.committed
        fault = self._piston_clock.take(stamp, now)
        arrival = self._live.sample(stamp, position, setpoints)
        if arrival in (Arrival.REPEATED, Arrival.IMPOSSIBLE):
            return arrival
        if arrival is not Arrival.ADVANCED:
            self._restart(stamp)
            before = None
        if fault is not None:
            self._note(fault, now)
        if setpoints != self._setpoints:
            self._setpoints, self._setpoints_changed = setpoints, stamp
            for name, setpoint in zip(convention.CYLINDERS, setpoints):
                self._window.setpoints[name].take(stamp if before is None else before.stamp, setpoint)
        self._window.displacement.take(stamp, position)
        self._piston_sensor.take(position)
        if self._is_stuck_while_pressures_move(stamp):
            why = f'{convention.PISTON_STATE} is stuck at {position:.6g} m while the pressures move'
            self._fault(Fault(convention.PISTON_STATE, 'stuck', why), stamp, now)
        return self._predict(stamp)

    def _predict(self, stamp: int) -> Prediction:
        committed = self._live.committed
        assert committed is not None
        state = committed.state
        values = (*state.readings, self._live.device.contact_force(state))
        rates = tuple(0.0 for _ in values)
        if self._predictions:
            last = self._predictions[-1]
            period = (stamp - last.stamp) / NANOSECONDS
            rates = tuple((value - old) / period for value, old in zip(values, last.values))
        prediction = Prediction(stamp, values, rates)
        self._predictions.append(prediction)
        while stamp - self._predictions[0].stamp > self.settings.max_gap * NANOSECONDS:
            self._predictions.popleft()
        return prediction

    def _is_stuck_while_pressures_move(self, stamp: int) -> bool:
        if not self._piston_sensor.paused or stamp - self._setpoints_changed < _SETTLING * NANOSECONDS:
            return False
        return all(self._lines[name].channel.agitation > _AGITATED for name in self._cylinders)

    def measured(self, channel: str, stamp: int, value: float, now: float) -> None:
        """Take a measured pressure [Pa] or force [N] of a channel at a stamp [ns], heard at a steady time [s]."""
        line = self._lines[channel]
        if line.clock.heard is None:
            self._share_false_alarms(1 + len(self.channels()))
        fault = line.clock.take(stamp, now) or self._apart(line, stamp, now)
        track = self._window.pressures.get(channel, self._window.force)
        if fault is not None:
            track.clear()
            line.restart()
            line.hold = stamp
            self.alarms.pop(channel, None)
            self._fault(fault, stamp, now)
        track.take(stamp, value)
        line.pending.append((stamp, value))

    def _share_false_alarms(self, channels: int) -> None:
        """Let so many channels together have the false alarms that are wanted; those that have learned keep theirs."""
        for line in self._lines.values():
            line.channel.mean_run = channels * self.settings.mean_time / self.settings.block

    def _apart(self, line: _Line, stamp: int, now: float) -> Fault | None:
        """Return the fault of a clock that is another than the piston's."""
        piston = self._piston_clock
        silence = piston.silence(now)
        if piston.stamp is None or silence is None or silence > self.settings.timeout:
            return None
        ahead = (stamp - piston.stamp) / NANOSECONDS
        if abs(ahead) <= self.settings.max_gap + silence:
            return None
        side = 'ahead of' if ahead > 0.0 else 'behind'
        why = f'the clock of {line.topic} is {abs(ahead):.3g} s {side} that of {convention.PISTON_STATE}'
        return Fault(line.topic, 'clock', why)

    def residuals(self, now: float) -> Iterator[Residual]:
        """Yield the residuals of what can be compared by now."""
        for line in self._lines.values():
            while line.pending and self._predictions and line.pending[0][0] <= self._predictions[-1].stamp:
                stamp, value = line.pending.popleft()
                expected = self._expected(line.index, stamp)
                if expected is not None:
                    yield Residual(line.channel.name, stamp, value - expected[0])
                    self._judge(line, stamp, value, *expected, now)

    def _expected(self, index: int, stamp: int) -> tuple[float, float] | None:
        """Return value and rate that are predicted for a stamp, linear between samples; None before the first."""
        after: Prediction | None = None
        for prediction in reversed(self._predictions):
            if prediction.stamp == stamp:
                return prediction.values[index], prediction.rates[index]
            if prediction.stamp < stamp:
                assert after is not None
                share = (stamp - prediction.stamp) / (after.stamp - prediction.stamp)
                value = prediction.values[index] + share * (after.values[index] - prediction.values[index])
                return value, after.rates[index]
            after = prediction
        return None

    def _judge(self, line: _Line, stamp: int, value: float, expected: float, rate: float, now: float) -> None:
        """Hand a value to its sensor's judge and, where nothing is wrong with the feed, to its charts."""
        fault = line.sensor.take(value, expected)
        block = stamp // round(self.settings.block * NANOSECONDS)
        if block != line.block:
            line.block = block
            fault = fault or line.sensor.close_block()
        if fault is not None:
            self._fault(fault, stamp, now)
        if stamp < line.hold or line.topic in self._faults or convention.PISTON_STATE in self._faults:
            return
        channel = line.channel
        learning = channel.baseline is None
        departure = channel.take(stamp, value - expected, rate)
        if learning and channel.baseline is not None:
            line.sensor.learned()
            self._piston_sensor.learned()
        if departure is not None:
            self._ring(departure, stamp)

    # faults of the feed

    def _note(self, fault: Fault, now: float) -> None:
        self._faults[fault.topic] = fault, now + _LINGER[fault.kind]

    def _fault(self, fault: Fault, stamp: int, now: float) -> None:
        """Suspend what a fault touches; it starts anew when the fault is over."""
        new = fault.topic not in self._faults
        self._note(fault, now)
        if fault.topic == convention.PISTON_STATE:
            if new:
                self._restart(stamp)
            return
        line = next(line for line in self._lines.values() if line.topic == fault.topic)
        line.hold = stamp + round(_SETTLING * NANOSECONDS)
        if new:
            line.channel.restart()
            self.alarms.pop(line.channel.name, None)
            self._breaks += 1

    def _restart(self, stamp: int) -> None:
        """Begin anew behind a break of the piston's samples; what was learned stays."""
        self._predictions.clear()
        self._window.clear()
        self._setpoints = None
        self._piston_sensor.restart()
        self._reference_tried = 0
        self.alarms.clear()
        self._breaks += 1
        for line in self._lines.values():
            line.restart()
            line.hold = stamp + round(_SETTLING * NANOSECONDS)

    def faults(self, now: float) -> list[Fault]:
        """Return what is wrong with the topics at a steady time [s]."""
        self._faults = {topic: kept for topic, kept in self._faults.items() if now < kept[1]}
        for clock, topic in self._clocks():
            silence = clock.silence(now)
            if silence is not None and silence > self.settings.timeout:
                self._note(Fault(topic, 'silent', f'{topic} has been silent for {silence:.1f} s'), now)
        return [fault for fault, _ in self._faults.values()]

    def missing(self) -> list[str]:
        """Return topics that were never heard; there may be no force."""
        return [topic for clock, topic in self._clocks() if clock.heard is None and topic != convention.MEASURED_FORCE]

    def _clocks(self) -> Iterator[tuple[Clock, str]]:
        yield self._piston_clock, convention.PISTON_STATE
        yield from ((line.clock, line.topic) for line in self._lines.values())

    # alarms

    def _ring(self, departure: Departure, stamp: int) -> None:
        alarm = self.alarms.get(departure.channel)
        if alarm is None:
            self.alarms[departure.channel] = Alarm(departure.since, departure.level, (stamp, stamp))
        else:
            alarm.rung = alarm.rung[0], stamp
            alarm.level |= departure.level

    @property
    def learned(self) -> float:
        """Share of what has to be learned that is [0 to 1]."""
        return min((line.channel.learned for line in self._lines.values() if line.clock.heard is not None), default=0.0)

    @property
    def stamp(self) -> int:
        """Of the last sample of the piston [ns]."""
        return self._predictions[-1].stamp if self._predictions else 0

    def channels(self) -> Mapping[str, WatchedSignal]:
        """Return the channels that something was heard of."""
        return {name: line.channel for name, line in self._lines.items() if line.clock.heard is not None}

    def departure(self, channel: str) -> Departure:
        """Return how a signal parts from its model now, where there is an alarm on it."""
        latest = self.stamp - round(_SHARE_TO_DIAGNOSE * self._window.length)
        alarm = self.alarms[channel]
        return self._lines[channel].channel.describe(max(alarm.since, latest), alarm.level)

    def stands(self, alarm: Alarm) -> bool:
        """Return whether an alarm has been confirmed: it keeps ringing, or what is new was found."""
        named = alarm.news is not None and bool(alarm.news.effects or alarm.news.gains or alarm.news.law)
        return named or alarm.rung[1] - alarm.rung[0] > self._window.length

    def look_after(self) -> None:
        """Have the loop closed where it is time, take its answers, and end alarms that ring no more."""
        self._take_answer()
        self.alarms = {
            name: alarm for name, alarm in self.alarms.items() if self.stamp - alarm.rung[1] <= self._window.length
        }
        if self._pending is not None or self.learned < 1.0:
            return
        due = [alarm.since for alarm in self.alarms.values() if self._is_due(alarm)]
        if due:
            self._close_loop(min(due), reference=False)
        elif self._reference is None and not self.alarms and self._is_long_enough(self._reference_tried, self.stamp):
            self._close_loop(0, reference=True)

    def _is_due(self, alarm: Alarm) -> bool:
        settled = alarm.since + round(_SETTLING * NANOSECONDS)
        return self._is_long_enough(max(settled, alarm.diagnosed), self.stamp)

    def _is_long_enough(self, begin: int, end: int) -> bool:
        return end - begin >= _SHARE_TO_DIAGNOSE * self._window.length

    def _close_loop(self, since: int, reference: bool) -> None:
        """Have the loop closed on what was heard since a stamp [ns], as far as the window reaches back."""
        end = self.stamp
        settled = since + round(_SETTLING * NANOSECONDS)
        begin = max(settled, self._window.begin, end - self._window.length)
        if self._is_long_enough(begin, end):
            answer = self._ask(self._window.recording(begin, end))
            self._pending = _Asked(answer, end, self._breaks, reference)

    def _take_answer(self) -> None:
        if self._pending is None or not self._pending.answer.done():
            return
        asked, self._pending = self._pending, None
        finding = asked.answer.result()
        if asked.reference:
            self._reference = None if finding.ended_early else finding
            self._reference_tried = asked.end
        elif asked.breaks == self._breaks:
            before = {} if self._reference is None else self._reference.found
            for name, alarm in self.alarms.items():
                alarm.diagnosed = asked.end
                alarm.failure = finding.failure
                found = finding.found.get(name)
                alarm.news = None if found is None else news(found, before.get(name))
