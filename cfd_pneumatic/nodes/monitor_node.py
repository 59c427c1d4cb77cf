# SPDX-License-Identifier: Apache-2.0
"""`monitor_node`: compares the device with its identified model, and reports departures."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import FluidPressure, JointState
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.identification import Options
from cfd_pneumatic.model import Arrival
from cfd_pneumatic.monitoring import (
    Settings,
    Watch,
    Worker,
    describe_agreement,
    describe_departure,
    describe_diagnosis,
    warm_up,
)
from cfd_pneumatic.nodes.health import REPEATED, join_texts
from cfd_pneumatic.nodes.model_node import ModelNode, invalid_stamp_text
from cfd_pneumatic.nodes.outputs import Outputs, ResidualOutputs, make_writers
from cfd_pneumatic.nodes.parameters import number
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.samples import force_reader, pressure_reader

_LOOK_PERIOD = 0.1  # period of the checks of diagnoses and silence [s]
_DIAGNOSTICS_PERIOD = 1.0  # [s]
_REPEAT = 60.0  # time between two log messages about the process for diagnoses [s]
_DAY = 86_400.0  # [s]
_LARGEST = 1e12  # largest pressure [Pa] and force [N]; beyond, the charts would leave floating point's range
_MODEL_INDEPENDENT = {
    'frame_id',
    'axis',
    'joint',
    'hardware_id',
    'stroke_lower',
    'stroke_upper',
}  # parameters that do not affect what is learned


class MonitorNode(ModelNode):
    """
    Compares a device with its model.

    Subscribes to the topics of the device: `piston_state`, `cylinder_*/setpoint`, `cylinder_*/pressure`,
    `measured_force`. Publishes measured minus predicted values on `cylinder_*/residual` and `contact_force/residual`,
    and the model's pressures and force below `predicted/`. `/diagnostics` reports whether device and model agree. The
    node learns the usual residuals in the first minutes; `~/learn` starts the learning again.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters, compile the model, start the process for diagnoses, and subscribe."""
        super().__init__('monitor_node', **kwargs)
        self._worker = Worker()
        self._watch = self._make_watch({})
        self._open_topics()
        self.add_on_set_parameters_callback(self._on_parameters)
        self.get_logger().info(f'ready for {convention.PISTON_STATE}')

    def _warm_up(self) -> None:
        super()._warm_up()
        warm_up()

    # parameters

    def _declare_parameters(self) -> None:
        super()._declare_parameters()
        declare = self.declare_parameter
        declare(
            'false_alarm_interval',
            _DAY,
            number('s', 60.0, 1e9, 'mean time between false alarms of all signals together'),
        )
        declare('learning', 300.0, number('s', 2.0, 1e5, 'how long the usual residuals are learned'))
        declare('diagnosis_window', 60.0, number('s', 10.0, 600.0, 'longest stretch that a diagnosis of an alarm uses'))
        declare('block', 0.2, number('s', 0.02, 10.0, 'time over which residuals are averaged before the test'))
        declare(
            'pressure_tolerance',
            -1.0,
            number('Pa', -1.0, 1e5, 'accepted shift of the mean residual of a pressure; -1: its drift while learning'),
        )
        declare(
            'force_tolerance',
            -1.0,
            number('N', -1.0, 1e3, 'accepted shift of the mean residual of the force; -1: its drift while learning'),
        )

    def _make_watch(self, changes: Mapping[str, Any]) -> Watch:
        pressure, force = (self._value(f'{name}_tolerance', changes) for name in ('pressure', 'force'))
        settings = Settings(
            mean_time=self._value('false_alarm_interval', changes),
            learning=self._value('learning', changes),
            window=self._value('diagnosis_window', changes),
            block=self._value('block', changes),
            timeout=self._value('timeout', changes),
            max_gap=self._value('max_gap', changes),
            pressure_tolerance=None if pressure < 0.0 else pressure,
            force_tolerance=None if force < 0.0 else force,
        )
        options = Options(
            ambient_pressure=self._value('ambient_pressure', changes),
            close_loop=True,
            geometric_factor=self._value('geometric_factor', changes),
        )
        diagnose = partial(self._worker.diagnose, options=options)
        return Watch(self._device, settings, diagnose, self._supply)

    def _apply_changes(self, changes: Mapping[str, Any]) -> None:
        """Apply changed parameters; learn anew if the model changes, because its usual residuals change."""
        self._orient(changes)
        if not changes.keys() <= _MODEL_INDEPENDENT:
            self._watch = self._make_watch(changes)

    def _orient(self, changes: Mapping[str, Any]) -> None:
        frame_id, axis = self._value('frame_id', changes), self._value('axis', changes)
        writers = make_writers(self, frame_id, axis)
        for out in (self._outputs, self._residuals):
            out.set_writers(writers)
        self._readers = {name: pressure_reader(self) for name in self._cylinders}
        self._readers[convention.CONTACT_FORCE] = force_reader(self, axis)

    # topics

    def _open_topics(self) -> None:
        self._outputs = Outputs(self, self._cylinders, convention.CONTACT_FORCE, convention.PREDICTED)
        self._residuals = ResidualOutputs(self, self._cylinders)
        self._orient({})
        # set-points first: SingleThreadedExecutor delivers messages of the same time in this order
        self._listen_to_setpoints()
        self._listen_to_samples(JointState, convention.PISTON_STATE, self._on_piston)
        for name in self._cylinders:
            self._listen_to_measured(FluidPressure, name, convention.pressure_topic(name))
        self._listen_to_measured(WrenchStamped, convention.CONTACT_FORCE, convention.MEASURED_FORCE)
        self.create_service(Trigger, '~/learn', self._on_learn)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a stopped /clock must not stop the watchdog
        self.create_timer(_LOOK_PERIOD, self._check_watch, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)

    def _listen_to_measured(self, message_type: type, channel: str, topic: str) -> None:
        self._listen_to_samples(message_type, topic, partial(self._on_measured, channel, topic))

    def _commit(self, stamp: int, position: float) -> bool:
        now = time.monotonic()
        setpoints = self._absolute_setpoints()
        prediction = self._watch.add_piston_sample(stamp, position, setpoints, now)
        if prediction is Arrival.IMPOSSIBLE:
            return False
        if isinstance(prediction, Arrival):
            self._health.counts[REPEATED] += 1
            return True
        *pressures, force = prediction.values
        self._note_sample(pressures)
        self._outputs.publish(stamp, pressures, force)
        self._outputs.publish_applied(stamp, setpoints)
        self._publish_residuals(now)
        return True

    def _on_measured(self, channel: str, topic: str, message: bytes) -> None:
        sample = self._readers[channel].read(message)
        if sample is None or not abs(sample[1]) <= _LARGEST:  # NaN fails the comparison, too
            self._health.counts['ignored measurements'] += 1
            self._health.warn(f'ignored: {topic} {sample and sample[1]}, not a possible measurement')
            return
        stamp = self._stamp(sample[0], topic)
        if stamp is None:
            self._health.warn(f'ignored: {invalid_stamp_text(topic)}')
            return
        if channel in self._cylinders:
            self._range.measured(channel, sample[1])
        now = time.monotonic()
        self._watch.add_measurement(channel, stamp, sample[1], now)
        self._publish_residuals(now)

    def _publish_residuals(self, now: float) -> None:
        for residual in self._watch.new_residuals(now):
            self._residuals.publish(*residual)

    def _on_learn(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Learn the usual residuals again, as after a repair."""
        self._watch = self._make_watch({})
        response.success = True
        response.message = f'the usual residuals are learned again for {self._value("learning"):g} s'
        return response

    def _check_watch(self) -> None:
        self._watch.faults(time.monotonic())
        self._watch.update_alarms()

    # diagnostics

    def _publish_diagnostics(self) -> None:
        feed = {key: str(count) for key, count in sorted(self._health.counts.items())}
        self._publish_status(
            'feed',
            self._feed_status(),
            feed | {'defaults': self._listed_defaults(), 'not identifiable': self._listed_not_identifiable()},
        )
        for name, signal in self._watch.signals().items():
            values = {'times that a chart has rung': str(signal.ring_count)}
            if signal.baseline is not None:
                unit = 'N' if name == convention.CONTACT_FORCE else 'Pa'
                values[f'usual residual, root mean square [{unit}]'] = f'{signal.usual_rms:.4g}'
                values[f'tolerance of the mean [{unit}]'] = f'{signal.baseline.mean.tolerance:.4g}'
                values['largest sum over its threshold [-]'] = f'{signal.alarm_proximity:.3f}'
            self._publish_status(name, self._channel_status(name), values)

        self._worker.restart_if_ended()
        self._publish_status('diagnosis', self._worker_status(), {'process started again': str(self._worker.restarts)})

    def _worker_status(self) -> tuple[bytes, str]:
        """Return level and message on the process for diagnoses."""
        fault = self._worker.fault
        if fault is None:
            return DiagnosticStatus.OK, 'ready'
        if self._worker.is_running:
            self.get_logger().warning(fault, throttle_duration_sec=_REPEAT)
            return DiagnosticStatus.WARN, fault
        self.get_logger().error(f'alarms are not diagnosed: {fault}', throttle_duration_sec=_REPEAT)
        return DiagnosticStatus.ERROR, f'alarms are not diagnosed: {fault}'

    def _feed_status(self) -> tuple[bytes, str]:
        """Return level and message on the topics."""
        faults = self._watch.faults(time.monotonic())
        missing = self._watch.missing_topics()
        warnings = [fault.message for fault in faults]
        warnings += [f'no {topic} yet' for topic in missing]
        if self._health.foreign_input is not None and self._health.silence > self._value('timeout'):
            warnings.append(self._health.foreign_input)
        if self._health.fault is not None and convention.PISTON_STATE not in missing:
            warnings.append(self._health.fault)
        lasting, troubles = self._lasting_warnings(), self._health.recent_troubles()
        if not warnings and not lasting and troubles is None:
            return DiagnosticStatus.OK, f'following {convention.PISTON_STATE}'
        is_transient = not missing and all(fault.kind == 'clock' for fault in faults)
        return DiagnosticStatus.WARN if is_transient else DiagnosticStatus.ERROR, join_texts(
            *warnings, *lasting, troubles
        )

    def _channel_status(self, name: str) -> tuple[bytes, str]:
        """Return level and message on a cylinder or the contact force."""
        watch = self._watch
        signal = watch.signals()[name]
        if signal.learned_share < 1.0:
            return DiagnosticStatus.OK, f'learning the usual residual: {100.0 * signal.learned_share:.0f} %'
        alarm = watch.alarms.get(name)
        if alarm is None:
            return DiagnosticStatus.OK if signal.misfit is None else DiagnosticStatus.WARN, describe_agreement(signal)
        follows = name == convention.CONTACT_FORCE and len(watch.alarms) > 1
        level = DiagnosticStatus.ERROR if watch.is_confirmed(alarm) else DiagnosticStatus.WARN
        return level, f'{describe_departure(watch.departure(name))}: {describe_diagnosis(alarm, follows)}'

    def destroy_node(self) -> None:
        """End the process for diagnoses, even during a diagnosis."""
        self._worker.end()
        super().destroy_node()


main = partial(run, 'monitor_node', MonitorNode)

if __name__ == '__main__':
    sys.exit(main())
