"""`sim_node`: the device's model, driven by piston displacement and set-points."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.compiling import announced
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import (
    Arrival,
    Cylinder,
    Device,
    DeviceState,
    ForceGeometry,
    LiveDevice,
    warm_up,
)
from cfd_pneumatic.model.effects import FORCE_EFFECTS, PRESSURE_EFFECTS
from cfd_pneumatic.nodes.health import InputHealth, diagnostics
from cfd_pneumatic.nodes.messages import (
    AXES,
    COMMAND_QOS,
    OUTPUT_QOS,
    SAMPLE_QOS,
    joint_position,
    nanoseconds,
)
from cfd_pneumatic.nodes.outputs import Outputs
from cfd_pneumatic.nodes.parameters import (
    declare_effects,
    declare_operating_points,
    effects,
    number,
    operating_points,
    switch,
    text,
    wrong_type,
)
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.topics import listen_to
from cfd_pneumatic.units import PSI

_DIAGNOSTICS_PERIOD = 1.0  # [s]
_COUNTED = ('samples', 'repeated stamps', 'resets', 'ignored samples', 'ignored set-points', 'zero stamps')
_SEAL_PLAY = f'{convention.CONTACT_FORCE}.seal_play'
_GEOMETRY = ('area', 'geometric_factor', 'ambient_pressure')


class SimNode(Node):
    """
    Pressures and contact force of the model, answered sample by sample.

    Subscribes `piston_state`, `cylinder_*/setpoint`, `force_setpoint`; publishes `cylinder_*/pressure`,
    `cylinder_*/setpoint_applied`, `contact_force` and `/diagnostics`; serves `~/reset`. The pressure is what the
    cylinder's sensor reads; the contact force follows from the pressure in the chamber, which is another one where an
    effect on the sensor is on. Effects on the force, as friction, change it alone. Every parameter is described, with
    its unit, in its descriptor.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters, compile the model, and listen."""
        super().__init__('sim_node', **kwargs)
        self._declare_parameters()
        self._single = not self._value('cylinder_b.enabled')
        self._cylinders = convention.CYLINDERS[:1] if self._single else convention.CYLINDERS
        self._live = LiveDevice(self._make_device({}), self._value('max_gap'))
        self._setpoints = [self._value(f'{cylinder}.initial_setpoint') for cylinder in convention.CYLINDERS]
        for index, name in enumerate(self._cylinders):
            refusal = self._refusal(self._setpoints[index])
            if refusal is not None:
                raise InputError(f'{name}.initial_setpoint is {refusal}')
        self._health = InputHealth(self, convention.PISTON_STATE)
        with announced(self._on_compiling):
            warm_up()
        self._open_topics()
        self.add_on_set_parameters_callback(self._on_parameters)
        self.get_logger().info(f'ready for {convention.PISTON_STATE}')

    # parameters

    def _value(self, name: str, changes: Mapping[str, Any] | None = None) -> Any:
        if changes and name in changes:
            return changes[name]
        return self.get_parameter(name).value

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare('joint', convention.PISTON_JOINT, text('name of the piston joint in piston_state'))
        declare('frame_id', 'cfd', text('frame of contact_force and of the pressures'))
        declare(
            'axis',
            'x',
            text(
                'axis of frame_id along which contact_force points',
                "x, 'y' (in quotes: YAML takes a bare y for true) or z",
            ),
        )
        declare('area', 1.14e-3, number('m^2', 1e-6, 1.0, 'piston area of either cylinder'))
        declare('geometric_factor', 1.0, number('-', -1e3, 1e3, 'contact force over piston force, from the linkage'))
        declare(
            'ambient_pressure',
            convention.AMBIENT_PRESSURE,
            number('Pa', 1e4, 2e5, 'absolute pressure that gauge set-points are counted from'),
        )
        declare(
            'supply_pressure',
            convention.SUPPLY_PRESSURE,
            number('Pa', 1e4, 2e6, 'gauge; a set-point above it is ignored'),
        )
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
            declare_effects(self, cylinder, PRESSURE_EFFECTS)
            declare(
                f'{cylinder}.initial_setpoint',
                10.0 * PSI,
                number('Pa', -1e5, 2e6, 'gauge set-point until one arrives', read_only=True),
            )
        declare_effects(self, convention.CONTACT_FORCE, FORCE_EFFECTS)
        declare(
            _SEAL_PLAY,
            2e-6,
            number(
                'm',
                0.0,
                1e-3,
                'half of the play with which seals follow the displacement, lest noise turn them round: half a bit '
                'of its sensor, or three standard deviations of its noise',
            ),
        )

    def _make_device(self, changes: Mapping[str, Any]) -> Device:
        if self._value('axis', changes) not in AXES:
            raise InputError(f'axis {self._value("axis", changes)!r} is not one of {", ".join(AXES)}')
        ambient = self._value('ambient_pressure', changes)
        a, b = (
            Cylinder(operating_points(self, name, changes), ambient, effects(self, name, PRESSURE_EFFECTS, changes))
            for name in convention.CYLINDERS
        )
        geometry = ForceGeometry(*(self._value(name, changes) for name in _GEOMETRY))
        if geometry.geometric_factor == 0.0:
            raise InputError('geometric_factor is 0: no force could be set or derived')
        force_effects = effects(self, convention.CONTACT_FORCE, FORCE_EFFECTS, changes)
        return Device(a, None if self._single else b, geometry, force_effects, self._value(_SEAL_PLAY, changes))

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters as every node does, but say which one is of a wrong type."""
        refusal = wrong_type(self, parameter_list)
        if refusal is not None:
            return SetParametersResult(successful=False, reason=refusal)
        return super().set_parameters_atomically(parameter_list)

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take good values from the next sample on; reject others with the reason."""
        changes = {parameter.name: parameter.value for parameter in parameters}
        try:
            device = self._make_device(changes)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._live.device = device
        self._live.max_gap = self._value('max_gap', changes)
        self._outputs.orient(self._value('frame_id', changes), self._value('axis', changes))
        return SetParametersResult(successful=True)

    def _on_compiling(self, folder: str | None) -> None:
        kept = f'once: it is kept in {folder}'
        if folder is None:
            kept = 'for this run only: no cache can be written, name a folder for it in NUMBA_CACHE_DIR'
        self.get_logger().info(f'compiling the model, {kept}')

    # topics

    def _open_topics(self) -> None:
        self._outputs = Outputs(self, self._cylinders, convention.CONTACT_FORCE, OUTPUT_QOS)
        self._outputs.orient(self._value('frame_id'), self._value('axis'))
        self._diagnostics_out = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT_QOS)
        # set-points first: SingleThreadedExecutor hands over in this order what is there at the same time
        for index, name in enumerate(self._cylinders):
            topic = convention.setpoint_topic(name)
            listen_to(self, Float64, topic, partial(self._on_setpoint, index), COMMAND_QOS)
        listen_to(self, Float64, convention.FORCE_SETPOINT, self._on_force_setpoint, COMMAND_QOS)
        listen_to(self, JointState, convention.PISTON_STATE, self._on_piston, SAMPLE_QOS)
        self.create_service(Trigger, '~/reset', self._on_reset)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a stopped /clock must not stop the watchdog
        self.create_timer(self._value('preview_period'), self._preview, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)

    def _on_setpoint(self, index: int, message: Float64) -> None:
        refusal = self._refusal(message.data)
        if refusal is not None:
            self._ignore_setpoint(f'{convention.setpoint_topic(self._cylinders[index])} {refusal}')
            return
        self._setpoints[index] = message.data

    def _on_force_setpoint(self, message: Float64) -> None:
        pair = self._live.device.geometry.setpoints(message.data, self._value('bias_pressure'), self._single)
        for name, setpoint in zip(self._cylinders, pair):
            refusal = self._refusal(setpoint)
            if refusal is not None:
                self._ignore_setpoint(
                    f'force_setpoint {message.data:g} N needs {convention.setpoint_topic(name)} {refusal}'
                )
                return
        self._setpoints[:] = pair

    def _refusal(self, setpoint: float) -> str | None:
        """Return why a gauge set-point [Pa] cannot act, or None."""
        if not math.isfinite(setpoint):
            return f'{setpoint}, not a finite number'
        if setpoint < -self._live.device.geometry.ambient_pressure:
            return f'{setpoint:.0f} Pa, below vacuum'
        if setpoint > self._value('supply_pressure'):
            return f'{setpoint:.0f} Pa, above the supply pressure {self._value("supply_pressure"):.0f} Pa'
        return None

    def _ignore_setpoint(self, what: str) -> None:
        self._health.counts['ignored set-points'] += 1
        self._health.warn('set-point', f'ignored: {what}')

    def _on_piston(self, message: JointState) -> None:
        joint = self._value('joint')
        position = joint_position(message, joint)
        if position is None:
            self._health.counts['ignored samples'] += 1
            named = ', '.join(map(repr, message.name)) or 'none'
            self._health.bad(f'{convention.PISTON_STATE} has no usable position of joint {joint!r} (joints: {named})')
            return
        self._health.good()
        self._commit(self._stamp(message), position)

    def _stamp(self, message: JointState) -> int:
        """Return a sample's stamp [ns]; the time of receipt where it has none, as from a bare `ros2 topic pub`."""
        stamp = nanoseconds(message.header.stamp)
        if stamp != 0:
            return stamp
        if not self._health.counts['zero stamps']:
            self.get_logger().warning(
                f'{convention.PISTON_STATE} has a zero stamp: the time of receipt is taken instead'
            )
        self._health.counts['zero stamps'] += 1
        return self.get_clock().now().nanoseconds

    def _commit(self, stamp: int, position: float) -> None:
        last = self._live.committed
        setpoints = self._absolute_setpoints()
        arrival = self._live.sample(stamp, position, setpoints)
        if arrival is Arrival.REPEATED:
            self._health.counts['repeated stamps'] += 1
            return
        self._health.counts['samples'] += 1
        if last is not None and arrival is not Arrival.ADVANCED:
            self._warn_of_reset(arrival, (stamp - last.stamp) * 1e-9)
        committed = self._live.committed
        assert committed is not None
        self._publish(stamp, committed.state)
        self._outputs.publish_applied(setpoints)

    def _warn_of_reset(self, arrival: Arrival, moved: float) -> None:
        """Warn that the model started anew, `moved` seconds after the last sample."""
        self._health.counts['resets'] += 1
        if arrival is Arrival.DIVERGED:
            reason = 'the effects that are on drove the model out of the range of numbers; weaken them'
        else:
            reason = (
                f'the stamp of {convention.PISTON_STATE} moved by {moved:.6f} s '
                f'(allowed: forward, at most max_gap {self._live.max_gap:g} s)'
            )
        self._health.warn('reset', f'started anew at rest: {reason}')

    def _absolute_setpoints(self) -> tuple[float, float]:
        device = self._live.device
        for index, cylinder in enumerate((device.a, device.b)):
            if cylinder is not None and not cylinder.parameters.covers(self._setpoints[index]):
                self._health.warn(
                    f'operating points {index}',
                    f'{self._cylinders[index]}: set-point {self._setpoints[index]:.0f} Pa lies outside the operating '
                    f'points {cylinder.parameters.setpoints[0]:.0f} to {cylinder.parameters.setpoints[-1]:.0f} Pa: '
                    'the nearest gains are held',
                )
        ambient = device.geometry.ambient_pressure
        return self._setpoints[0] + ambient, self._setpoints[1] + ambient

    def _publish(self, stamp: int, state: DeviceState) -> None:
        pressures = [cylinder.reading for cylinder in (state.a, state.b) if cylinder is not None]
        self._outputs.publish(stamp, pressures, self._live.device.contact_force(state))

    def _preview(self) -> None:
        """
        While piston_state is silent show what the pressures do meanwhile, the piston held.

        No longer than `max_gap`, after which the model starts anew anyway, and not where the input is faulty. What was
        applied is not published: a preview is no sample.
        """
        committed = self._live.committed
        silence = self._health.silence
        if committed is None or self._health.fault is not None:
            return
        if self._value('preview_period') <= silence <= self._live.max_gap:
            state = self._live.preview(silence, self._absolute_setpoints())
            if state is not None:
                self._publish(committed.stamp + round(silence * 1e9), state)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._live.reset()
        response.success = True
        response.message = 'the next piston sample starts the model at rest'
        return response

    def _publish_diagnostics(self) -> None:
        values = {key: str(self._health.counts[key]) for key in _COUNTED}
        for name, setpoint in zip(self._cylinders, self._setpoints):
            values[f'{name} set-point, gauge [Pa]'] = f'{setpoint:.1f}'
        for name, cylinder in zip(self._cylinders, (self._live.device.a, self._live.device.b)):
            if cylinder is not None:
                values[f'{name} effects'] = ', '.join(cylinder.effects) or 'none'
        values[f'{convention.CONTACT_FORCE} effects'] = ', '.join(self._live.device.force_effects) or 'none'
        committed = self._live.committed
        if committed is not None:
            for name, state in zip(self._cylinders, (committed.state.a, committed.state.b)):
                if state is not None:
                    values[f'{name} pressure, absolute [Pa]'] = f'{state.reading:.1f}'
        verdict = self._health.verdict(self._value('timeout'))
        self._diagnostics_out.publish(diagnostics(self, 'input', *verdict, values))


def main(args: Sequence[str] | None = None) -> None:
    """Run `sim_node`."""
    sys.exit(run('sim_node', SimNode, args))


if __name__ == '__main__':
    main()
