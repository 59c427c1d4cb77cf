# SPDX-License-Identifier: Apache-2.0
"""`sim_node`: the device's model, driven by piston displacement and set-points."""

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
from cfd_pneumatic.nodes.outputs import Answers, Outputs, writers
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
    Pressures and contact force of the model, answered sample by sample.

    Subscribes `piston_state`, `cylinder_*/setpoint`, `force_setpoint`; publishes `cylinder_*/pressure`,
    `cylinder_*/setpoint_applied`, `contact_force` and `/diagnostics`, and below `preview/` where pressures and force go
    while `piston_state` is silent; serves `~/reset`. The pressure is what the
    cylinder's sensor reads; the contact force follows from the pressure in the chamber, which is another one where an
    effect on the sensor is on. Effects on the force, as friction, change it alone. Every parameter is described, with
    its unit, in its descriptor.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters, compile the model, and listen."""
        super().__init__('sim_node', **kwargs)
        self._live = LiveDevice(self._device, self._value('max_gap'), self._supply)
        self._open_topics()
        self.add_on_set_parameters_callback(self._on_parameters)
        self.get_logger().info(f'ready for {convention.PISTON_STATE}')

    # parameters

    def _declare_parameters(self) -> None:
        super()._declare_parameters()
        self.declare_parameter(
            'bias_pressure', 10.0 * PSI, number('Pa', 0.0, 2e6, 'gauge mean of the pair that force_setpoint sets')
        )
        self.declare_parameter(
            'preview_period',
            0.1,
            number('s', 1e-2, 10.0, 'how often previews are published while piston_state is silent', read_only=True),
        )

    def _adopt(self, changes: Mapping[str, Any]) -> None:
        self._live.device, self._live.supply = self._device, self._supply
        self._live.max_gap = self._value('max_gap', changes)
        self._orient(changes)

    def _orient(self, changes: Mapping[str, Any]) -> None:
        made = writers(self, self._value('frame_id', changes), self._value('axis', changes))
        for out in (self._outputs, self._previews):
            out.orient(made)

    # topics

    def _open_topics(self) -> None:
        self._outputs = Outputs(self, self._cylinders, convention.CONTACT_FORCE)
        self._previews = Answers(self, self._cylinders, convention.CONTACT_FORCE, convention.PREVIEW)
        self._orient({})
        # set-points first: SingleThreadedExecutor hands over in this order what is there at the same time
        self._listen_to_setpoints()
        self._listen_to_commands(convention.FORCE_SETPOINT, self._on_force_setpoint)
        self._listen_to_samples(JointState, convention.PISTON_STATE, self._on_piston)
        self.create_service(Trigger, '~/reset', self._on_reset)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a stopped /clock must not stop the watchdog
        self.create_timer(self._value('preview_period'), self._preview, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)

    def _on_force_setpoint(self, message: Float64) -> None:
        pair = self._device.setpoints(message.data, self._value('bias_pressure'))
        wanted = dict(zip(convention.CYLINDERS, pair))
        for name in self._cylinders:
            refusal = self._refusal(wanted[name])
            if refusal is not None:
                self._ignore_setpoint(
                    convention.FORCE_SETPOINT,
                    f'force_setpoint {message.data:g} N needs {convention.setpoint_topic(name)} {refusal}',
                )
                return
        self._refused_setpoints.clear()
        self._setpoints.update(wanted)
        self._waiting.clear()

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
            publishers = self.count_publishers(self.resolve_topic_name(convention.PISTON_STATE))
            if publishers > 1:
                reason += f'; {publishers} publish it'
        self._health.warn(f'started anew at rest: {reason}')

    def _publish(self, out: Answers, stamp: int, state: DeviceState) -> None:
        out.publish(stamp, state.readings, self._live.device.contact_force(state))

    def _preview(self) -> None:
        """
        While piston_state is silent show what the pressures do meanwhile, the piston held.

        No longer than `max_gap`, after which the model starts anew anyway, not where the input is faulty, and not
        where no stamp is left. What was applied is not published: a preview is no sample.
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
        values['defaults'] = self._told_defaults()
        values['not identifiable'] = self._told_doubtful()
        values[f'{convention.CONTACT_FORCE} effects'] = ', '.join(self._live.device.force_effects) or 'none'
        committed = self._live.committed
        if committed is not None:
            for name, state in zip(convention.CYLINDERS, (committed.state.a, committed.state.b)):
                if state is not None:
                    values[f'{name} pressure, absolute [Pa]'] = f'{state.reading:.1f}'
        self._say('input', self._health.verdict(self._value('timeout'), self._standing()), values)


main = partial(run, 'sim_node', SimNode)

if __name__ == '__main__':
    sys.exit(main())
