# SPDX-License-Identifier: Apache-2.0
"""`rig_node`: the virtual test rig, which publishes the topics of a real device's drivers."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import IntegerRange, ParameterDescriptor, ParameterType, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from cfd_pneumatic import convention
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes.bounded_node import BoundedNode
from cfd_pneumatic.nodes.health import Warnings
from cfd_pneumatic.nodes.messages import COMMAND_QOS, LATEST, stamp_message
from cfd_pneumatic.nodes.outputs import Outputs, make_writers
from cfd_pneumatic.nodes.parameters import FRAME_LENGTH, checked_frame, given_value, number, switch, text
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.topics import create_publisher, subscribe_latched
from cfd_pneumatic.rig import (
    DEVICES,
    LONGEST,
    SCHEDULES,
    Bench,
    CommandedPiston,
    Performance,
    Rig,
    RigParameters,
    RigRecord,
    Sensors,
    device_named,
    paper_step,
    record,
    schedule_named,
    with_faults,
)
from cfd_pneumatic.units import PSI

_STEPS_PER_SAMPLE = 10  # steps of the commanded piston in a sample
_MOST_CAUGHT_UP = 20  # largest number of samples in a tick, so that callbacks and signals are handled in between
_WAITING_PERIOD = 0.05  # [s]
_DELIVERY = 4.0  # longest wait for the delivery of the last messages; DDS repeats requests every 3 s [s]


class CommandedRig:
    """A rig with a commanded piston and commanded set-points."""

    remaining = math.inf
    """Number of remaining samples."""

    def __init__(self, bench: Bench, piston: CommandedPiston, setpoints: tuple[float, float]) -> None:
        self._bench = bench
        self.piston = piston
        self.setpoints = setpoints

    def change(self, parameters: RigParameters) -> None:
        """Change the effects of the rig from the next sample on."""
        self._bench.change(parameters)

    def advance(self, samples: int) -> RigRecord:
        """Simulate and return the next samples."""
        positions, velocities = self.piston.move(
            samples * _STEPS_PER_SAMPLE, self._bench.sampling_period / _STEPS_PER_SAMPLE
        )
        return self._bench.advance(positions, velocities, [self.setpoints] * samples)


class RigNode(BoundedNode):
    """
    A virtual device.

    Publishes `piston_state`, `cylinder_*/pressure`, `cylinder_*/setpoint_applied` and `measured_force`. With a schedule
    the node also publishes `cylinder_*/setpoint`. Without a schedule the node subscribes to `cylinder_*/setpoint` and
    `piston_command`. The parameter `faults` changes the device while the node runs.

    Parameters
    ----------
    parameters
        Parameters of the rig; default: those of the device that the parameter `device` names.
    sensors
        Sensors of the rig.
    kwargs
        Arguments of `Node`.

    """

    def __init__(self, parameters: RigParameters | None = None, sensors: Sensors = Sensors(), **kwargs: Any) -> None:
        """Declare parameters, compile the physics, and begin the motion."""
        super().__init__('rig_node', **kwargs)
        self._declare_parameters()
        self._warnings = Warnings(self)
        self._period = 1.0 / self._value('sample_rate')
        self._joint, self._frame = self._value('joint'), checked_frame(self._value('frame_id'))
        self._healthy = device_named(self._value('device')) if parameters is None else parameters
        self._sensors = sensors
        self._device = with_faults(self._healthy, self._value('faults'))
        record(paper_step(), self._healthy)  # compiles the physics before the first sample is due
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._published = 0
        self._position: float | None = None
        self._announced: tuple[tuple[float, float], tuple[int, ...]] | None = None
        self._open_outputs()
        self._motion: Performance | CommandedRig
        if self._value('schedule'):
            self._motion = self._make_performance()
            self._commands_out = [
                create_publisher(self, Float64, convention.setpoint_topic(name)) for name in convention.CYLINDERS
            ]
            self._subscribed_since: float | None = None
            self._waiting = self.create_timer(_WAITING_PERIOD, self._await_subscribers, clock=self._steady)
        else:
            self._commands_out = []
            self._motion = self._make_commanded_rig()
            self._begin()
        self.add_on_set_parameters_callback(self._on_parameters)

    # parameters

    def _value(self, name: str) -> Any:
        return given_value(self.get_parameter(name).value)

    def _declare_parameters(self) -> None:
        self.declare_parameter(
            'faults',
            '',
            text(
                "faults of the device, at run time: 'effects_a.leak_conductance=1e-10'; none, or empty: no faults",
                'list of PART.FIELD=NUMBER: effects_a, effects_b, pickup, a field of rig/effects.py; odd_a, odd_b, '
                'odd_force, a field of rig/oddities.py; SI units',
            ),
        )

        def declare(name: str, default: Any, descriptor: ParameterDescriptor) -> None:
            descriptor.read_only = True
            self.declare_parameter(name, default, descriptor)

        declare('device', 'real', text('device: real physics, or constant gains', ' or '.join(DEVICES)))
        declare('joint', convention.PISTON_JOINT, text('name of the piston joint in piston_state'))
        declare('frame_id', 'cfd', text('frame of measured_force and of the pressures', FRAME_LENGTH))
        declare('sample_rate', 500.0, number('Hz', 1.0, 2000.0, 'samples per second'))
        declare('seed', 0, _integer(0, 2**31 - 1, "seed of the sensors' noise and of the surface"))
        declare(
            'schedule',
            '',
            text(
                'schedule to play; none, or empty: follow piston_command',
                f'none, {", ".join(SCHEDULES)}, or the schedule.csv of plan_experiment or force_on_path',
            ),
        )
        declare(
            'schedule_setpoint',
            0.0,
            number('Pa', 0.0, 5e5, 'gauge set-point of cylinder A in the schedule; 0: default of the schedule'),
        )
        declare(
            'schedule_amplitude',
            0.0,
            number('m', -5e-3, 5e-3, 'displacement in the schedule; 0: default of the schedule'),
        )
        declare(
            'schedule_duration',
            0.0,
            number('s', 0.0, LONGEST, 'length of surface_following; 0: default of the schedule'),
        )
        declare(
            'start_subscribers', 0, _integer(0, 100, 'number of subscribers to piston_state that a schedule waits for')
        )
        declare(
            'start_delay', 0.5, number('s', 0.0, 60.0, 'pause between the arrival of the subscribers and the schedule')
        )
        declare('repeat', False, switch('repeat the schedule, with a return motion in between'))
        declare('exit_when_done', False, switch('end the program after the schedule'))
        declare('speed_limit', 0.2, number('m/s', 1e-4, 1.0, 'highest speed of the motion to a piston_command'))
        declare(
            'acceleration_limit',
            50.0,
            number('m/s^2', 1e-2, 500.0, 'highest acceleration of the motion to a piston_command'),
        )
        for cylinder in convention.CYLINDERS:
            declare(
                f'{cylinder}.initial_setpoint',
                10.0 * PSI,
                number('Pa', -1e5, 2e6, 'gauge set-point before the first message, without a schedule'),
            )

    def _on_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Apply changed faults from the next sample on."""
        for parameter in parameters:
            if parameter.name == 'faults':
                try:
                    self._motion.change(with_faults(self._healthy, given_value(parameter.value)))
                except InputError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _make_performance(self) -> Performance:
        name = self._value('schedule')
        options = {
            option: self._value(f'schedule_{option}')
            for option in ('setpoint', 'amplitude', 'duration')
            if self._value(f'schedule_{option}') != 0.0
        }
        if name == 'surface_following':
            options['seed'] = self._value('seed')
        schedule = schedule_named(name, **options, sampling_period=self._period)
        repeat = self._value('repeat')
        if repeat:
            schedule = schedule.with_return()
        return Performance(schedule, self._device, self._sensors, self._value('seed'), repeat=repeat)

    def _make_commanded_rig(self) -> CommandedRig:
        first, second = (self._value(f'{cylinder}.initial_setpoint') for cylinder in convention.CYLINDERS)
        rig = Rig((first, second), self._device)
        piston = CommandedPiston(
            rig.position, self._device.piston.travel, self._value('speed_limit'), self._value('acceleration_limit')
        )
        commanded = CommandedRig(Bench(rig, self._period, self._sensors, self._value('seed')), piston, (first, second))

        def on_piston_command(message: Float64) -> None:
            if math.isfinite(message.data):
                piston.command(message.data)
            else:
                self._warnings.warn(f'ignored: piston_command {message.data:g} m, not a finite number')

        listen = partial(subscribe_latched, self, Float64, qos=COMMAND_QOS, on_large=self._warnings.warn)
        listen(convention.PISTON_COMMAND, on_piston_command)
        for index, name in enumerate(convention.CYLINDERS):
            on_setpoint = partial(self._on_setpoint, commanded, index)
            listen(convention.setpoint_topic(name), on_setpoint)
        return commanded

    def _on_setpoint(self, commanded: CommandedRig, index: int, message: Float64) -> None:
        """Set a regulator from the next sample on."""
        setpoint, air = message.data, self._device.air
        if not 0.0 < setpoint + air.ambient_pressure < air.supply_pressure:
            self._warnings.warn(
                f'ignored: {convention.setpoint_topic(convention.CYLINDERS[index])} {setpoint:g} Pa, which is not '
                'between vacuum and supply pressure'
            )
            return
        first, second = commanded.setpoints
        commanded.setpoints = (setpoint, second) if index == 0 else (first, setpoint)

    # topics

    def _open_outputs(self) -> None:
        self._piston_out = create_publisher(self, JointState, convention.PISTON_STATE)
        self._outputs = Outputs(self, convention.CYLINDERS, convention.MEASURED_FORCE)
        self._outputs.set_writers(make_writers(self, self._frame, 'x'))

    def _publish(self, sample: RigRecord) -> None:
        stamp = self._epoch + round(float(sample.times[0]) * 1e9)
        position = float(sample.displacement[0])
        speed = 0.0 if self._position is None else (position - self._position) / self._period
        self._position = position
        self._published += 1
        if stamp > LATEST:
            self._warnings.warn('not published: the time exceeds what a ROS stamp can hold')
            return
        piston = JointState(name=[self._joint], position=[position], velocity=[speed])
        piston.header.stamp = stamp_message(stamp)
        piston.header.frame_id = self._frame
        self._piston_out.publish(piston)
        self._outputs.publish(stamp, sample.pressures[0].tolist(), float(sample.force[0]))
        self._outputs.publish_applied(stamp, sample.setpoints[0].tolist())

    def _announce(self) -> None:
        """
        Publish a schedule's set-points when they change, and for new subscribers.

        Set-points are published right after the sample before the change: a set-point acts from the next sample on.
        """
        state = (self._motion.setpoints, tuple(out.get_subscription_count() for out in self._commands_out))
        if state == self._announced:
            return
        self._announced = state
        for out, setpoint in zip(self._commands_out, self._motion.setpoints):
            out.publish(Float64(data=setpoint))

    # time

    def _seconds(self) -> float:
        return self._steady.now().nanoseconds * 1e-9

    def _await_subscribers(self) -> None:
        """Begin the schedule `start_delay` after its subscribers have arrived."""
        self._announce()
        if self._piston_out.get_subscription_count() < self._value('start_subscribers'):
            self._subscribed_since = None
            return
        if self._subscribed_since is None:
            self._subscribed_since = self._seconds()
        if self._seconds() - self._subscribed_since >= self._value('start_delay'):
            self._waiting.cancel()
            self.get_logger().info(f'playing {self._value("schedule")}')
            self._begin()

    def _begin(self) -> None:
        self._epoch = self.get_clock().now().nanoseconds
        self._began = self._seconds()
        self._ticking = self.create_timer(self._period, self._tick, clock=self._steady)

    def _tick(self) -> None:
        """Publish every sample that is due, including samples of missed ticks."""
        due = math.floor((self._seconds() - self._began) / self._period) + 1
        for _ in range(min(due - self._published, _MOST_CAUGHT_UP)):
            if not self._motion.remaining:
                break
            self._publish(self._motion.advance(1))
            self._announce()
        if not self._motion.remaining:
            self._finish()

    def _finish(self) -> None:
        """Stop after the schedule; with `exit_when_done` end the program after the last delivery."""
        self._ticking.cancel()
        self.get_logger().info(f'played {self._published} samples')
        if self._value('exit_when_done'):
            self._await_delivery()
            self.context.try_shutdown()

    def _await_delivery(self) -> None:
        limit = self._seconds() + _DELIVERY
        for out in self.publishers:
            if not out.wait_for_all_acked(Duration(seconds=max(limit - self._seconds(), 0.0))):
                self.get_logger().warning(f'{out.topic_name}: not every subscriber has received the last samples')


def _integer(lower: int, upper: int, description: str) -> ParameterDescriptor:
    """Return the descriptor of a whole number in a range."""
    return ParameterDescriptor(
        type=ParameterType.PARAMETER_INTEGER,
        description=description,
        integer_range=[IntegerRange(from_value=lower, to_value=upper, step=1)],
    )


main = partial(run, 'rig_node', RigNode)

if __name__ == '__main__':
    sys.exit(main())
