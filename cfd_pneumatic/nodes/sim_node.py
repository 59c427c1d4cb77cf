# SPDX-License-Identifier: Apache-2.0
"""`sim_node`: simulates the device from piston displacement and set-points."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.model import Arrival, DeviceState, LiveDevice
from cfd_pneumatic.nodes.health import LARGE, LOST, MISMATCHED, REPEATED, WITHOUT_JOINT
from cfd_pneumatic.nodes.messages import LATEST
from cfd_pneumatic.nodes.model_node import ModelNode
from cfd_pneumatic.nodes.outputs import Outputs, SignalOutputs, make_writers
from cfd_pneumatic.nodes.parameters import number
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.units import PSI

_DIAGNOSTICS_PERIOD = 1.0  # [s]
_COUNTED = (
    'samples', REPEATED, 'resets', 'ignored samples', 'ignored stamps', 'ignored set-points', 'zero stamps',
    WITHOUT_JOINT, LOST, MISMATCHED, LARGE
)  # fmt: skip


class SimNode(ModelNode):
    """
    Simulates pressures and contact force for each sample of the piston.

    Subscribes to `piston_state`, `cylinder_*/setpoint`, `force_setpoint`. Publishes `cylinder_*/pressure`,
    `cylinder_*/setpoint_applied`, `contact_force` and `/diagnostics`. While `piston_state` is silent, predictions are
    published below `preview/`. Serves `~/reset`.

    The published pressure is the reading of the cylinder's sensor. The contact force depends on the pressure in the
    chamber, which differs if an effect on the sensor is on. Effects on the force, as friction, change the force only.
    Each parameter is described, with its unit, in its descriptor.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters, compile the model, and subscribe."""
        super().__init__('sim_node', **kwargs)
        self._live = LiveDevice(self._device, self._value('max_gap'), self._supply)
        self._open_topics()
        self.add_on_set_parameters_callback(self._on_parameters)
        self.get_logger().info(f'ready for {convention.PISTON_STATE}')

    # parameters

    def _declare_parameters(self) -> None:
        super()._declare_parameters()
        self.declare_parameter(
            'bias_pressure',
            10.0 * PSI,
            number('Pa', 0.0, 2e6, 'gauge mean of the two set-points that force_setpoint sets'),
        )
        self.declare_parameter(
            'preview_period',
            0.1,
            number('s', 1e-2, 10.0, 'period of the previews while piston_state is silent', read_only=True),
        )

    def _apply_changes(self, changes: Mapping[str, Any]) -> None:
        self._live.device, self._live.supply = self._device, self._supply
        self._live.max_gap = self._value('max_gap', changes)
        self._orient(changes)

    def _orient(self, changes: Mapping[str, Any]) -> None:
        writers = make_writers(self, self._value('frame_id', changes), self._value('axis', changes))
        for out in (self._outputs, self._previews):
            out.set_writers(writers)

    # topics

    def _open_topics(self) -> None:
        self._outputs = Outputs(self, self._cylinders, convention.CONTACT_FORCE)
        self._previews = SignalOutputs(self, self._cylinders, convention.CONTACT_FORCE, convention.PREVIEW)
        self._orient({})
        # set-points first: SingleThreadedExecutor delivers messages of the same time in this order
        self._listen_to_setpoints()
        self._listen_to_commands(convention.FORCE_SETPOINT, self._on_force_setpoint)
        self._listen_to_samples(JointState, convention.PISTON_STATE, self._on_piston)
        self.create_service(Trigger, '~/reset', self._on_reset)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a stopped /clock must not stop the watchdog
        self.create_timer(self._value('preview_period'), self._publish_preview, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)

    def _on_force_setpoint(self, message: Float64) -> None:
        pair = self._device.setpoints(message.data, self._value('bias_pressure'))
        wanted = dict(zip(convention.CYLINDERS, pair))
        for name in self._cylinders:
            refusal = self._setpoint_refusal(wanted[name])
            if refusal is not None:
                self._ignore_setpoint(
                    convention.FORCE_SETPOINT,
                    f'force_setpoint {message.data:g} N needs {convention.setpoint_topic(name)} {refusal}',
                )
                return
        self._refused_setpoints.clear()
        self._setpoints.update(wanted)
        self._without_setpoint.clear()

    def _commit(self, stamp: int, position: float) -> bool:
        last = self._live.committed
        setpoints = self._absolute_setpoints()
        arrival = self._live.sample(stamp, position, setpoints)
        if arrival is Arrival.IMPOSSIBLE:
            return False
        if arrival is Arrival.REPEATED:
            self._health.counts[REPEATED] += 1
            return True
        if last is not None and arrival is not Arrival.ADVANCED:
            self._warn_of_reset(arrival, (stamp - last.stamp) * 1e-9)
        committed = self._live.committed
        assert committed is not None
        self._note_sample(committed.state.readings)
        self._publish(self._outputs, stamp, committed.state)
        self._outputs.publish_applied(stamp, setpoints)
        return True

    def _warn_of_reset(self, arrival: Arrival, step: float) -> None:
        """Warn of a restart of the model; `step` is the time since the last sample [s]."""
        self._health.counts['resets'] += 1
        if arrival is Arrival.DIVERGED:
            reason = 'the active effects drove the model out of the range of numbers; reduce their strengths'
        else:
            reason = (
                f'the stamp of {convention.PISTON_STATE} moved by {step:.6f} s '
                f'(allowed: forward, at most max_gap {self._live.max_gap:g} s)'
            )
            publishers = self.count_publishers(self.resolve_topic_name(convention.PISTON_STATE))
            if publishers > 1:
                reason += f'; {publishers} publishers send the topic'
        self._health.warn(f'the model started anew at rest: {reason}')

    def _publish(self, out: SignalOutputs, stamp: int, state: DeviceState) -> None:
        out.publish(stamp, state.readings, self._live.device.contact_force(state))

    def _publish_preview(self) -> None:
        """
        Publish a prediction with the piston held while piston_state is silent.

        There is no preview beyond `max_gap`, after which the model starts anew, after a faulty input, or beyond the
        largest stamp. Applied set-points are not published: a preview is no sample.
        """
        committed = self._live.committed
        silence = self._health.silence
        if committed is None or self._health.fault is not None:
            return
        stamp = committed.stamp + round(silence * 1e9)
        if self._value('preview_period') <= silence <= self._live.max_gap and stamp <= LATEST:
            state = self._live.preview(silence, self._absolute_setpoints())
            if state is not None:
                self._publish(self._previews, stamp, state)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Start the model anew, at rest, with the next sample."""
        self._live.reset()
        response.success = True
        response.message = 'the next piston sample starts the model at rest'
        return response

    def _publish_diagnostics(self) -> None:
        values = {key: str(self._health.counts[key]) for key in _COUNTED}
        for name, cylinder in self._device.cylinders.items():
            values[f'{name} set-point, gauge [Pa]'] = f'{self._setpoints[name]:.1f}'
            values[f'{name} effects'] = ', '.join(cylinder.effects) or 'none'
        values['defaults'] = self._listed_defaults()
        values['not identifiable'] = self._listed_not_identifiable()
        values[f'{convention.CONTACT_FORCE} effects'] = ', '.join(self._live.device.force_effects) or 'none'
        committed = self._live.committed
        if committed is not None:
            for name, state in zip(convention.CYLINDERS, (committed.state.a, committed.state.b)):
                if state is not None:
                    values[f'{name} pressure, absolute [Pa]'] = f'{state.reading:.1f}'
        self._publish_status('input', self._health.status(self._value('timeout'), self._lasting_warnings()), values)


main = partial(run, 'sim_node', SimNode)

if __name__ == '__main__':
    sys.exit(main())
