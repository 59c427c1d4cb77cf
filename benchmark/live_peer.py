# SPDX-License-Identifier: Apache-2.0
"""The live simulator as a user would write it: a timer at 1 kHz, rclpy's default executor, messages made anew."""

from __future__ import annotations

from collections import deque

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.model import TABLE_1, Cylinder, DeviceModel, ForceGeometry, LiveDevice
from cfd_pneumatic.units import PSI

CYLINDER = Cylinder(TABLE_1, AMBIENT_PRESSURE)
AREA = 1.14e-3
QUEUE = 200


class LivePeer(Node):
    def __init__(self):
        super().__init__('sim_node')
        self._live = LiveDevice(DeviceModel(CYLINDER, CYLINDER, ForceGeometry(AREA, 1.0, AMBIENT_PRESSURE)), 1.0)
        self._setpoints = [AMBIENT_PRESSURE + 10.0 * PSI] * 2
        self._samples = deque()
        names = ('cylinder_a', 'cylinder_b')
        self._pressures = [self.create_publisher(FluidPressure, f'{name}/pressure', 10) for name in names]
        self._applied = [self.create_publisher(FluidPressure, f'{name}/setpoint_applied', 10) for name in names]
        self._force = self.create_publisher(WrenchStamped, 'contact_force', 10)
        self.create_subscription(Float64, 'cylinder_a/setpoint', lambda message: self._set(0, message), QUEUE)
        self.create_subscription(Float64, 'cylinder_b/setpoint', lambda message: self._set(1, message), QUEUE)
        self.create_subscription(JointState, 'piston_state', lambda sample: self._samples.append(sample), QUEUE)
        self.create_timer(1e-3, self._step)
        self.get_logger().info('ready for piston_state')

    def _set(self, index, message):
        self._setpoints[index] = message.data + AMBIENT_PRESSURE

    def _step(self):
        while self._samples:
            sample = self._samples.popleft()
            time = sample.header.stamp
            self._live.sample(time.sec * 1_000_000_000 + time.nanosec, sample.position[0], tuple(self._setpoints))
            state = self._live.committed.state
            for publisher, pressure in zip(
                (*self._pressures, *self._applied), (state.a.reading, state.b.reading, *self._setpoints)
            ):
                answer = FluidPressure()
                answer.header = sample.header
                answer.fluid_pressure = pressure
                publisher.publish(answer)
            answer = WrenchStamped()
            answer.header = sample.header
            answer.wrench.force.x = self._live.device.contact_force(state)
            self._force.publish(answer)


def main():
    rclpy.init()
    rclpy.spin(LivePeer())


if __name__ == '__main__':
    main()
