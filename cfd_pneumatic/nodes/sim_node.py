"""`sim_node`: the device's model, driven by piston displacement and set-points."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import Arrival, Cylinder, Device, DeviceState, ForceGeometry, LiveDevice
from cfd_pneumatic.nodes.messages import (
    AXES,
    COMMAND_QOS,
    OUTPUT_QOS,
    SAMPLE_QOS,
    force_message,
    joint_position,
    nanoseconds,
    pressure_message,
)
from cfd_pneumatic.nodes.parameters import declare_operating_points, number, operating_points, switch, text
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.units import PSI

_THROTTLE = 5.0  # a warning that keeps coming is repeated this often [s]
_DIAGNOSTICS_PERIOD = 1.0  # [s]
_GEOMETRY = ('area', 'geometric_factor', 'ambient_pressure')


class SimNode(Node):
    """
    Pressures and contact force of the model, answered sample by sample.

    Subscribes `piston_state`, `cylinder_*/setpoint`, `force_setpoint`; publishes `cylinder_*/pressure`,
    `cylinder_*/setpoint_applied`, `contact_force` and `/diagnostics`; serves `~/reset`. Every parameter is described,
    with its unit, in its descriptor.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters, compile the model, and listen."""
        super().__init__('sim_node', **kwargs)
        self._declare_parameters()
        self._single = not self._value('cylinder_b.enabled')
        self._cylinders = convention.CYLINDERS[:1] if self._single else convention.CYLINDERS
        self._live = LiveDevice(self._make_device({}), self._value('max_gap'))
        self._setpoints = [self._value(f'{cylinder}.initial_setpoint') for cylinder in convention.CYLINDERS]
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._last_input = self._seconds()
        self._counts = dict.fromkeys(
            ('samples', 'repeated stamps', 'resets', 'ignored samples', 'ignored set-points', 'zero stamps'), 0
        )
        self._fault: str | None = 'no piston sample yet'
        self._warm_up()
        self._open_topics()
        self.add_on_set_parameters_callback(self._on_parameters)

    # parameters

    def _value(self, name: str, changes: Mapping[str, Any] | None = None) -> Any:
        if changes and name in changes:
            return changes[name]
        return self.get_parameter(name).value

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare('joint', convention.PISTON_JOINT, text('name of the piston joint in piston_state'))
        declare('frame_id', 'cfd', text('frame of contact_force and of the pressures'))
        declare('axis', 'x', text('axis of frame_id along which contact_force points', ' or '.join(AXES)))
        declare('area', 1.14e-3, number('m^2', 1e-6, 1.0, 'piston area of either cylinder'))
        declare('geometric_factor', 1.0, number('-', -1e3, 1e3, 'contact force over piston force, from the linkage'))
        declare(
            'ambient_pressure',
            convention.AMBIENT_PRESSURE,
            number('Pa', 1e4, 2e5, 'absolute pressure that gauge set-points are counted from'),
        )
        declare('supply_pressure', 75.0 * PSI, number('Pa', 1e4, 2e6, 'gauge; a set-point above it is ignored'))
        declare('bias_pressure', 10.0 * PSI, number('Pa', 0.0, 2e6, 'gauge mean of the pair that force_setpoint sets'))
        declare('max_gap', 1.0, number('s', 1e-3, 1e3, 'a longer step between samples starts the model anew'))
        declare('timeout', 0.5, number('s', 1e-2, 1e3, 'silence of piston_state that /diagnostics calls an error'))
        declare(
            'preview_period',
            0.1,
            number('s', 1e-2, 10.0, 'how often previews are published while piston_state is silent', read_only=True),
        )
        declare('cylinder_b.enabled', True, switch('false: one cylinder against ambient pressure', read_only=True))
        for cylinder in convention.CYLINDERS:
            declare_operating_points(self, cylinder)
            declare(
                f'{cylinder}.initial_setpoint',
                10.0 * PSI,
                number('Pa', -1e5, 2e6, 'gauge set-point until one arrives', read_only=True),
            )

    def _make_device(self, changes: Mapping[str, Any]) -> Device:
        if self._value('axis', changes) not in AXES:
            raise InputError(f'axis {self._value("axis", changes)!r} is not one of {", ".join(AXES)}')
        ambient = self._value('ambient_pressure', changes)
        a, b = (Cylinder(operating_points(self, name, changes), ambient) for name in convention.CYLINDERS)
        geometry = ForceGeometry(*(self._value(name, changes) for name in _GEOMETRY))
        if geometry.geometric_factor == 0.0:
            raise InputError('geometric_factor is 0: no force could be set or derived')
        return Device(a, None if self._single else b, geometry)

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take good values from the next sample on; reject others with the reason."""
        changes = {parameter.name: parameter.value for parameter in parameters}
        try:
            device = self._make_device(changes)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._live.device = device
        self._live.max_gap = self._value('max_gap', changes)
        return SetParametersResult(successful=True)

    def _warm_up(self) -> None:
        """Compile the model, or load it compiled, before the first sample has to be answered."""
        device = self._live.device
        state = device.at_rest(2e5, 2e5)
        device.step(state, 1e-3, 1e-3, 2e5, 2e5)

    # topics

    def _open_topics(self) -> None:
        overridable = QoSOverridingOptions.with_default_policies()

        def publisher(message_type: type, topic: str) -> Publisher:
            return self.create_publisher(message_type, topic, OUTPUT_QOS, qos_overriding_options=overridable)

        self._pressure_out = [publisher(FluidPressure, convention.pressure_topic(name)) for name in self._cylinders]
        self._applied_out = [
            publisher(FluidPressure, convention.setpoint_applied_topic(name)) for name in self._cylinders
        ]
        self._force_out = publisher(WrenchStamped, convention.CONTACT_FORCE)
        self._diagnostics_out = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT_QOS)
        for index, name in enumerate(self._cylinders):
            self.create_subscription(
                Float64,
                convention.setpoint_topic(name),
                lambda message, index=index: self._on_setpoint(index, message),
                COMMAND_QOS,
                qos_overriding_options=overridable,
            )
        self.create_subscription(
            Float64,
            convention.FORCE_SETPOINT,
            self._on_force_setpoint,
            COMMAND_QOS,
            qos_overriding_options=overridable,
        )
        self.create_subscription(
            JointState, convention.PISTON_STATE, self._on_piston, SAMPLE_QOS, qos_overriding_options=overridable
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        # steady time: a stopped /clock must not stop the watchdog
        self.create_timer(self._value('preview_period'), self._on_preview_timer, clock=self._steady)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=self._steady)

    def _seconds(self) -> float:
        return self._steady.now().nanoseconds * 1e-9

    def _warn(self, key: str, message: str) -> None:
        """Warn, at most once in a while; rclpy throttles by the calling line, so that each kind has its own."""
        now = self._seconds()
        warned = self.__dict__.setdefault('_warned', {})
        if now - warned.get(key, -math.inf) >= _THROTTLE:
            warned[key] = now
            self.get_logger().warning(message)

    def _on_setpoint(self, index: int, message: Float64) -> None:
        refusal = self._refusal(message.data)
        if refusal is not None:
            self._ignore_setpoint(f'{self._cylinders[index]}/setpoint {refusal}')
            return
        self._setpoints[index] = message.data

    def _on_force_setpoint(self, message: Float64) -> None:
        pair = self._live.device.geometry.setpoints(message.data, self._value('bias_pressure'), self._single)
        for name, setpoint in zip(self._cylinders, pair):
            refusal = self._refusal(setpoint)
            if refusal is not None:
                self._ignore_setpoint(f'force_setpoint {message.data:g} N needs {name}/setpoint {refusal}')
                return
        self._setpoints[:] = pair

    def _refusal(self, setpoint: float) -> str | None:
        """Return why a gauge set-point [Pa] cannot act, or None."""
        if not math.isfinite(setpoint):
            return 'that is not finite'
        if setpoint < -self._live.device.geometry.ambient_pressure:
            return f'{setpoint:.0f} Pa, below vacuum'
        if setpoint > self._value('supply_pressure'):
            return f'{setpoint:.0f} Pa, above the supply pressure {self._value("supply_pressure"):.0f} Pa'
        return None

    def _ignore_setpoint(self, what: str) -> None:
        self._counts['ignored set-points'] += 1
        self._warn('setpoint', f'ignored: {what}')

    def _on_piston(self, message: JointState) -> None:
        joint = self._value('joint')
        position = joint_position(message, joint)
        if position is None:
            self._counts['ignored samples'] += 1
            self._fault = f'piston_state holds no finite position of joint {joint!r} (it names {list(message.name)})'
            self._warn('piston', f'ignored: {self._fault}')
            return
        stamp = nanoseconds(message.header.stamp)
        if stamp == 0:
            stamp = self.get_clock().now().nanoseconds
            if self._counts['zero stamps'] == 0:
                self.get_logger().warning('piston_state has a zero stamp: the time of receipt is taken instead')
            self._counts['zero stamps'] += 1
        self._commit(stamp, position)

    def _commit(self, stamp: int, position: float) -> None:
        last = self._live.committed
        setpoints = self._absolute_setpoints()
        arrival = self._live.sample(stamp, position, setpoints)
        self._last_input = self._seconds()
        self._fault = None
        if arrival is Arrival.REPEATED:
            self._counts['repeated stamps'] += 1
            return
        self._counts['samples'] += 1
        if last is not None and arrival is not Arrival.ADVANCED:
            self._counts['resets'] += 1
            self._warn(
                'reset',
                f'started anew at rest: the stamp of piston_state moved by {(stamp - last.stamp) * 1e-9:.6f} s '
                f'(allowed: forward, at most max_gap {self._live.max_gap:g} s)',
            )
        committed = self._live.committed
        assert committed is not None
        self._publish(stamp, committed.state, setpoints)

    def _absolute_setpoints(self) -> tuple[float, float]:
        device = self._live.device
        for index, cylinder in enumerate((device.a, device.b)):
            if cylinder is not None and not cylinder.parameters.covers(self._setpoints[index]):
                self._warn(
                    f'schedule {index}',
                    f'{self._cylinders[index]}: set-point {self._setpoints[index]:.0f} Pa lies outside the operating '
                    f'points {cylinder.parameters.setpoints[0]:.0f} to {cylinder.parameters.setpoints[-1]:.0f} Pa: '
                    'the nearest gains are held',
                )
        ambient = device.geometry.ambient_pressure
        return self._setpoints[0] + ambient, self._setpoints[1] + ambient

    def _publish(self, stamp: int, state: DeviceState, setpoints: tuple[float, float]) -> None:
        frame = self._value('frame_id')
        for publisher, cylinder in zip(self._pressure_out, (state.a, state.b)):
            if cylinder is not None:
                publisher.publish(pressure_message(stamp, frame, cylinder.p))
        for publisher, setpoint in zip(self._applied_out, setpoints):
            publisher.publish(pressure_message(stamp, frame, setpoint))
        force = self._live.device.contact_force(state)
        self._force_out.publish(force_message(stamp, frame, self._value('axis'), force))

    def _on_preview_timer(self) -> None:
        """While piston_state is silent show what the pressures do meanwhile, the piston held."""
        committed = self._live.committed
        elapsed = self._seconds() - self._last_input
        if committed is None or not self._value('preview_period') <= elapsed <= self._live.max_gap:
            return
        setpoints = self._absolute_setpoints()
        state = self._live.preview(elapsed, setpoints)
        if state is not None:
            self._publish(committed.stamp + round(elapsed * 1e9), state, setpoints)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._live.reset()
        response.success = True
        response.message = 'the next piston sample starts the model at rest'
        return response

    # health

    def _publish_diagnostics(self) -> None:
        silence = self._seconds() - self._last_input
        status = DiagnosticStatus(
            name=f'{self.get_fully_qualified_name()}: input', hardware_id=self.get_fully_qualified_name()
        )
        if silence > self._value('timeout'):
            status.level = DiagnosticStatus.ERROR
            status.message = self._fault or f'piston_state has been silent for {silence:.1f} s'
        elif self._fault is not None:
            status.level = DiagnosticStatus.WARN
            status.message = self._fault
        else:
            status.level = DiagnosticStatus.OK
            status.message = 'following piston_state'
        status.values = [KeyValue(key=key, value=str(count)) for key, count in self._counts.items()]
        for name, setpoint in zip(self._cylinders, self._setpoints):
            status.values.append(KeyValue(key=f'{name} set-point, gauge [Pa]', value=f'{setpoint:.1f}'))
        committed = self._live.committed
        if committed is not None:
            for name, cylinder in zip(self._cylinders, (committed.state.a, committed.state.b)):
                if cylinder is not None:
                    status.values.append(KeyValue(key=f'{name} pressure, absolute [Pa]', value=f'{cylinder.p:.1f}'))
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_out.publish(message)


def main(args: Sequence[str] | None = None) -> None:
    """Run `sim_node`."""
    sys.exit(run('sim_node', SimNode, args))


if __name__ == '__main__':
    main()
