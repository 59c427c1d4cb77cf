# SPDX-License-Identifier: Apache-2.0
"""The watch over a device: predictions, residuals, faults of topics, alarms and their diagnoses."""

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
from cfd_pneumatic.monitoring.feed import Fault, SensorMonitor, StampMonitor
from cfd_pneumatic.monitoring.finding import Finding, NewFindings, new_findings
from cfd_pneumatic.monitoring.watched_signal import Departure, WatchedSignal
from cfd_pneumatic.monitoring.window import Window
from cfd_pneumatic.recording import Recording

_SETTLING = 1.0  # time after which the start or an earlier fault no longer affects the pressures [s]
_FAULT_HOLD = {'silent': 5.0, 'clock': 5.0, 'stuck': 1.0}  # how long a fault is reported after its last detection [s]
_MOST_PENDING = 5000  # largest number of measured values that wait for the displacement
_PRESSURES_MOVE = 3.0  # residual over noise from which on pressures move while the displacement does not
_DIAGNOSED_SHARE = 1.0 / 3.0  # share of the window between a change, or a diagnosis, and the next diagnosis

RequestDiagnosis = Callable[[Recording], 'Future[Finding]']
"""Requests that the loop is closed on a recording in another process."""


@dataclass(frozen=True)
class Settings:
    """
    Settings of a watch.

    Attributes
    ----------
    mean_time
        Mean time between false alarms [s].
    learning
        How long the usual residuals are learned [s].
    window
        Longest stretch that a diagnosis uses [s].
    block
        Time over which residuals are averaged [s].
    timeout
        Silence of a topic from which on it is a fault [s].
    max_gap
        Longest time between samples that is no gap [s].
    pressure_tolerance, force_tolerance
        Accepted lasting shift of the mean residual [Pa, N]; None: its drift while learning.

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
    """Values that the model predicts at a sample of the piston."""

    stamp: int
    """Stamp of the sample [ns]."""

    values: tuple[float, ...]
    """Pressures of the cylinders [Pa] and contact force [N]."""

    rates: tuple[float, ...]
    """Rates of change since the sample before [Pa/s, N/s]."""


class Residual(NamedTuple):
    """Measured less predicted."""

    channel: str
    """`cylinder_a`, `cylinder_b` or `contact_force`."""

    stamp: int
    """Stamp of the measured value [ns]."""

    value: float
    """Residual [Pa or N]."""


class _Feed:
    """A measured topic: checks of its stamps and sensor, and the signal that is watched."""

    def __init__(self, index: int, topic: str, unit: str, signal: WatchedSignal, settings: Settings) -> None:
        self.index = index
        self.topic = topic
        self.signal = signal
        self.clock = StampMonitor(topic, settings.max_gap)
        self.sensor = SensorMonitor(topic, unit)
        self.pending: deque[tuple[int, float]] = deque(maxlen=_MOST_PENDING)
        self.ignore_before = 0
        self.block_index = -1

    def restart(self) -> None:
        """Begin anew after a break."""
        self.signal.restart()
        self.sensor.restart()
        self.pending.clear()


@dataclass
class Alarm:
    """
    An alarm: a signal departs from its model.

    Attributes
    ----------
    since
        Stamp of the beginning [ns].
    is_mean_shift
        Whether the mean has shifted; otherwise the variance has grown.
    ring_stamps
        Stamps of the first and the last alarm of a chart [ns].
    diagnosed_until
        Stamp of the end of the last diagnosis, or 0 [ns].
    new_findings
        Changes of the diagnosis since the device was healthy, or None.
    failure
        Why there is no diagnosis, or None.

    """

    since: int
    is_mean_shift: bool
    ring_stamps: tuple[int, int]
    diagnosed_until: int = 0
    new_findings: NewFindings | None = None
    failure: str | None = None


class _PendingDiagnosis(NamedTuple):
    """A diagnosis that is running."""

    answer: Future[Finding]
    """Result when the diagnosis has ended."""

    end: int
    """Last stamp of its recording [ns]."""

    breaks_before: int
    """Number of breaks of the feed at the request: a later break makes the diagnosis useless."""

    is_reference: bool
    """Whether the diagnosis is of the healthy device."""


class Watch:
    """
    Compares a device with its model, raises alarms and requests diagnoses.

    Times are of two kinds: stamps of messages [ns], and the steady time of reception [s].

    Parameters
    ----------
    device
        The model.
    settings
        Settings of the watch.
    request_diagnosis
        Requests that the loop is closed on a recording.
    supply
        Absolute supply pressure, the upper limit of all pressures [Pa].

    """

    def __init__(
        self, device: DeviceModel, settings: Settings, request_diagnosis: RequestDiagnosis, supply: float = math.inf
    ) -> None:
        self.settings = settings
        self.alarms: dict[str, Alarm] = {}
        self._request_diagnosis = request_diagnosis
        self._live = LiveDevice(device, settings.max_gap, supply)
        self._cylinders = tuple(device.cylinders)
        self._predictions: deque[Prediction] = deque()
        self._window = Window(settings.window)
        self._piston_clock = StampMonitor(convention.PISTON_STATE, settings.max_gap)
        self._piston_sensor = SensorMonitor(convention.PISTON_STATE, 'm')
        self._setpoints: tuple[float, ...] | None = None
        self._setpoints_changed = 0
        self._faults: dict[str, tuple[Fault, float]] = {}
        self._feeds = self._make_feeds()
        self._breaks = 0
        self._pending: _PendingDiagnosis | None = None
        self._reference: Finding | None = None
        self._reference_tried = 0  # last stamp of the last recording of the healthy device [ns]

    def _make_feeds(self) -> dict[str, _Feed]:
        settings = self.settings
        feeds = {}
        for index, name in enumerate((*self._cylinders, convention.CONTACT_FORCE)):
            is_force = name == convention.CONTACT_FORCE
            signal = WatchedSignal(
                name,
                round(settings.learning / settings.block),
                round(settings.block * NANOSECONDS),
                settings.mean_time / settings.block,
                settings.force_tolerance if is_force else settings.pressure_tolerance,
            )
            topic = convention.MEASURED_FORCE if is_force else convention.pressure_topic(name)
            feeds[name] = _Feed(index, topic, 'N' if is_force else 'Pa', signal, settings)
        return feeds

    # received messages

    def add_piston_sample(
        self, stamp: int, position: float, setpoints: tuple[float, float], now: float
    ) -> Prediction | Arrival:
        """
        Add a sample of the piston and predict the signals.

        Parameters
        ----------
        stamp
            Stamp of the sample [ns].
        position
            Piston displacement [m].
        setpoints
            Absolute set-points of A and B that acted up to the sample [Pa].
        now
            Steady time [s].

        Returns
        -------
        Prediction or Arrival
            The arrival if there is no prediction: the stamp is repeated, or a pressure would be impossible.

        """
        before = self._live.committed
        fault = self._piston_clock.check(stamp, now)
        arrival = self._live.sample(stamp, position, setpoints)
        if arrival in (Arrival.REPEATED, Arrival.IMPOSSIBLE):
            return arrival
        if arrival is not Arrival.ADVANCED:
            self._restart(stamp)
            before = None
        if fault is not None:
            self._note_fault(fault, now)
        if setpoints != self._setpoints:
            self._setpoints, self._setpoints_changed = setpoints, stamp
            for name, setpoint in zip(convention.CYLINDERS, setpoints):
                self._window.setpoints[name].append(stamp if before is None else before.stamp, setpoint)
        self._window.displacement.append(stamp, position)
        self._piston_sensor.check(position)
        if self._is_stuck_while_pressures_move(stamp):
            message = f'{convention.PISTON_STATE} is stuck at {position:.6g} m while the pressures move'
            self._suspend(Fault(convention.PISTON_STATE, 'stuck', message), stamp, now)
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
            rates = tuple((value - last_value) / period for value, last_value in zip(values, last.values))
        prediction = Prediction(stamp, values, rates)
        self._predictions.append(prediction)
        while stamp - self._predictions[0].stamp > self.settings.max_gap * NANOSECONDS:
            self._predictions.popleft()
        return prediction

    def _is_stuck_while_pressures_move(self, stamp: int) -> bool:
        if not self._piston_sensor.is_paused or stamp - self._setpoints_changed < _SETTLING * NANOSECONDS:
            return False
        return all(self._feeds[name].signal.relative_spread > _PRESSURES_MOVE for name in self._cylinders)

    def add_measurement(self, channel: str, stamp: int, value: float, now: float) -> None:
        """Add a measured pressure [Pa] or force [N] of a channel: its stamp [ns] and steady time of reception [s]."""
        feed = self._feeds[channel]
        if feed.clock.heard_at is None:
            self._share_false_alarms(1 + len(self.signals()))
        fault = feed.clock.check(stamp, now) or self._clock_offset(feed, stamp, now)
        signal = self._window.pressures.get(channel, self._window.force)
        if fault is not None:
            signal.clear()
            feed.restart()
            feed.ignore_before = stamp
            self.alarms.pop(channel, None)
            self._suspend(fault, stamp, now)
        signal.append(stamp, value)
        feed.pending.append((stamp, value))

    def _share_false_alarms(self, channels: int) -> None:
        """Divide the false alarms among the channels; a channel that has learned keeps its rate."""
        for feed in self._feeds.values():
            feed.signal.mean_run = channels * self.settings.mean_time / self.settings.block

    def _clock_offset(self, feed: _Feed, stamp: int, now: float) -> Fault | None:
        """Return the fault of a topic whose clock differs from the piston's clock, or None."""
        piston = self._piston_clock
        silence = piston.silence(now)
        if piston.stamp is None or silence is None or silence > self.settings.timeout:
            return None
        ahead = (stamp - piston.stamp) / NANOSECONDS
        if abs(ahead) <= self.settings.max_gap + silence:
            return None
        side = 'ahead of' if ahead > 0.0 else 'behind'
        message = f'the clock of {feed.topic} is {abs(ahead):.3g} s {side} that of {convention.PISTON_STATE}'
        return Fault(feed.topic, 'clock', message)

    def new_residuals(self, now: float) -> Iterator[Residual]:
        """Yield residuals of measured values that can be compared with predictions by now."""
        for feed in self._feeds.values():
            while feed.pending and self._predictions and feed.pending[0][0] <= self._predictions[-1].stamp:
                stamp, value = feed.pending.popleft()
                expected = self._expected(feed.index, stamp)
                if expected is not None:
                    yield Residual(feed.signal.name, stamp, value - expected[0])
                    self._check_value(feed, stamp, value, *expected, now)

    def _expected(self, index: int, stamp: int) -> tuple[float, float] | None:
        """Return the predicted value and rate at a stamp, linear between samples; None before the first sample."""
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

    def _check_value(self, feed: _Feed, stamp: int, value: float, expected: float, rate: float, now: float) -> None:
        """Check the sensor with a value; add the residual to the charts unless the feed has a fault."""
        fault = feed.sensor.check(value, expected)
        block = stamp // round(self.settings.block * NANOSECONDS)
        if block != feed.block_index:
            feed.block_index = block
            fault = fault or feed.sensor.close_block()
        if fault is not None:
            self._suspend(fault, stamp, now)
        if stamp < feed.ignore_before or feed.topic in self._faults or convention.PISTON_STATE in self._faults:
            return
        signal = feed.signal
        learning = signal.baseline is None
        departure = signal.add_residual(stamp, value - expected, rate)
        if learning and signal.baseline is not None:
            feed.sensor.end_learning()
            self._piston_sensor.end_learning()
        if departure is not None:
            self._raise_alarm(departure, stamp)

    # faults of the feed

    def _note_fault(self, fault: Fault, now: float) -> None:
        self._faults[fault.topic] = fault, now + _FAULT_HOLD[fault.kind]

    def _suspend(self, fault: Fault, stamp: int, now: float) -> None:
        """Suspend the signals that a fault affects; they start anew when the fault is over."""
        new = fault.topic not in self._faults
        self._note_fault(fault, now)
        if fault.topic == convention.PISTON_STATE:
            if new:
                self._restart(stamp)
            return
        feed = next(feed for feed in self._feeds.values() if feed.topic == fault.topic)
        feed.ignore_before = stamp + round(_SETTLING * NANOSECONDS)
        if new:
            feed.signal.restart()
            self.alarms.pop(feed.signal.name, None)
            self._breaks += 1

    def _restart(self, stamp: int) -> None:
        """Begin anew after a break of the piston's samples; learned baselines stay."""
        self._predictions.clear()
        self._window.clear()
        self._setpoints = None
        self._piston_sensor.restart()
        self._reference_tried = 0
        self.alarms.clear()
        self._breaks += 1
        for feed in self._feeds.values():
            feed.restart()
            feed.ignore_before = stamp + round(_SETTLING * NANOSECONDS)

    def faults(self, now: float) -> list[Fault]:
        """Return the faults of the topics at a steady time [s]."""
        self._faults = {topic: kept for topic, kept in self._faults.items() if now < kept[1]}
        for clock, topic in self._clocks():
            silence = clock.silence(now)
            if silence is not None and silence > self.settings.timeout:
                self._note_fault(Fault(topic, 'silent', f'{topic} has been silent for {silence:.1f} s'), now)
        return [fault for fault, _ in self._faults.values()]

    def missing_topics(self) -> list[str]:
        """Return required topics without a message so far; the force is optional."""
        return [
            topic for clock, topic in self._clocks() if clock.heard_at is None and topic != convention.MEASURED_FORCE
        ]

    def _clocks(self) -> Iterator[tuple[StampMonitor, str]]:
        yield self._piston_clock, convention.PISTON_STATE
        yield from ((feed.clock, feed.topic) for feed in self._feeds.values())

    # alarms

    def _raise_alarm(self, departure: Departure, stamp: int) -> None:
        alarm = self.alarms.get(departure.channel)
        if alarm is None:
            self.alarms[departure.channel] = Alarm(departure.since, departure.is_mean_shift, (stamp, stamp))
        else:
            alarm.ring_stamps = alarm.ring_stamps[0], stamp
            alarm.is_mean_shift |= departure.is_mean_shift

    @property
    def learned_share(self) -> float:
        """Share of the learning that is complete [0 to 1]."""
        return min(
            (feed.signal.learned_share for feed in self._feeds.values() if feed.clock.heard_at is not None), default=0.0
        )

    @property
    def latest_stamp(self) -> int:
        """Stamp of the last sample of the piston [ns]."""
        return self._predictions[-1].stamp if self._predictions else 0

    def signals(self) -> Mapping[str, WatchedSignal]:
        """Return the signals with at least one message, by channel."""
        return {name: feed.signal for name, feed in self._feeds.items() if feed.clock.heard_at is not None}

    def departure(self, channel: str) -> Departure:
        """Return how a signal with an alarm departs from its model now."""
        latest = self.latest_stamp - round(_DIAGNOSED_SHARE * self._window.length)
        alarm = self.alarms[channel]
        return self._feeds[channel].signal.describe(max(alarm.since, latest), alarm.is_mean_shift)

    def is_confirmed(self, alarm: Alarm) -> bool:
        """Return whether an alarm is confirmed: charts keep giving alarms, or the diagnosis has changed."""
        findings = alarm.new_findings
        named = findings is not None and bool(findings.effects or findings.gains or findings.characteristic)
        return named or alarm.ring_stamps[1] - alarm.ring_stamps[0] > self._window.length

    def update_alarms(self) -> None:
        """Request due diagnoses, take their results, and end alarms without recent alarms of a chart."""
        self._take_answer()
        self.alarms = {
            name: alarm
            for name, alarm in self.alarms.items()
            if self.latest_stamp - alarm.ring_stamps[1] <= self._window.length
        }
        if self._pending is not None or self.learned_share < 1.0:
            return
        due = [alarm.since for alarm in self.alarms.values() if self._is_due(alarm)]
        if due:
            self._close_loop(min(due), is_reference=False)
        elif (
            self._reference is None
            and not self.alarms
            and self._is_long_enough(self._reference_tried, self.latest_stamp)
        ):
            self._close_loop(0, is_reference=True)

    def _is_due(self, alarm: Alarm) -> bool:
        settled = alarm.since + round(_SETTLING * NANOSECONDS)
        return self._is_long_enough(max(settled, alarm.diagnosed_until), self.latest_stamp)

    def _is_long_enough(self, begin: int, end: int) -> bool:
        return end - begin >= _DIAGNOSED_SHARE * self._window.length

    def _close_loop(self, since: int, is_reference: bool) -> None:
        """Request a diagnosis of the recording since a stamp [ns], within the window."""
        end = self.latest_stamp
        settled = since + round(_SETTLING * NANOSECONDS)
        begin = max(settled, self._window.begin, end - self._window.length)
        if self._is_long_enough(begin, end):
            answer = self._request_diagnosis(self._window.recording(begin, end))
            self._pending = _PendingDiagnosis(answer, end, self._breaks, is_reference)

    def _take_answer(self) -> None:
        if self._pending is None or not self._pending.answer.done():
            return
        pending, self._pending = self._pending, None
        finding = pending.answer.result()
        if pending.is_reference:
            self._reference = None if finding.ended_early else finding
            self._reference_tried = pending.end
        elif pending.breaks_before == self._breaks:
            before = {} if self._reference is None else self._reference.diagnoses
            for name, alarm in self.alarms.items():
                alarm.diagnosed_until = pending.end
                alarm.failure = finding.failure
                diagnosis = finding.diagnoses.get(name)
                alarm.new_findings = None if diagnosis is None else new_findings(diagnosis, before.get(name))
