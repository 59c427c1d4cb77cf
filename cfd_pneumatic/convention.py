# SPDX-License-Identifier: Apache-2.0
"""
Names that the nodes, the recordings and the rig agree on.

Topic names are relative: a namespace tells the real device (``/cfd/device``) from its simulator (``/cfd/sim``). A
signal that is recorded is a row of `ROLES`; what reads, writes, maps, compares and documents signals goes by that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

CYLINDERS = ('cylinder_a', 'cylinder_b')
"""Cylinder A grows with +x, cylinder B shrinks."""

PISTON_STATE = 'piston_state'
PISTON_COMMAND = 'piston_command'
FORCE_SETPOINT = 'force_setpoint'
CONTACT_FORCE = 'contact_force'
MEASURED_FORCE = 'measured_force'
RESULT = '~/result'
DIAGNOSTICS = '/diagnostics'

PISTON_JOINT = 'piston'
"""Default name of the joint in `PISTON_STATE`."""

PREDICTED = 'predicted/'
"""What the monitor's model predicts is published below this name, under the names that it is measured by."""

PREVIEW = 'preview/'
"""Where pressures and force go while the piston is silent is published below this name."""

AMBIENT_PRESSURE = 101_325.0
"""Default ambient pressure, absolute [Pa]."""

AMBIENT_PRESSURES = (1e4, 2e5)
"""The lowest and the highest ambient pressure that is believed, absolute [Pa]."""

SUPPLY_PRESSURE = 517_106.8
"""Default supply pressure, gauge: 75 psi, as the paper has it [Pa]. A set-point above it is refused."""

PISTON_AREA = 1.14e-3
"""Default area of either piston [m^2]."""

AREAS = (1e-6, 1.0)
"""The smallest and the largest area of a piston that is believed [m^2]."""

FACTORS = (-1e3, 1e3)
"""The smallest and the largest geometric factor that is believed, contact force over piston force [-]."""

SCHEDULE_COLUMNS = ('time_s', 'displacement_m', 'velocity_m_per_s', 'cylinder_a_setpoint_pa', 'cylinder_b_setpoint_pa')
"""Head of a schedule in a file: set-points are gauge and hold from their time on."""


JOINT_STATE = 'sensor_msgs/msg/JointState'
FLUID_PRESSURE = 'sensor_msgs/msg/FluidPressure'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
FLOAT64 = 'std_msgs/msg/Float64'

EITHER = 'cylinder_*'
"""Stands for the name of either cylinder in what is said of both."""


@dataclass(frozen=True)
class Role:
    """
    What a recorded signal is.

    Attributes
    ----------
    name : str
        In mappings and messages for people.
    topic : str
        On which it is; of a cylinder's with `EITHER` in the cylinder's place.
    msgtype : str
        Type of the messages.
    quantity : str
        `length`, `pressure` or `force`.
    meaning : str
        What the topic carries, with its unit.
    held : bool
        Whether a value holds until the next.
    gauge : bool
        Whether pressures in messages are above ambient.

    """

    name: str
    topic: str
    msgtype: str
    quantity: str
    meaning: str
    held: bool = False
    gauge: bool = False

    @property
    def of_cylinder(self) -> bool:
        """Whether each cylinder has one."""
        return EITHER in self.topic

    def topic_of(self, cylinder: str | None = None) -> str:
        """Return the topic, of a cylinder where each has one."""
        return self.topic.replace(EITHER, cylinder or EITHER)


ROLES: Mapping[str, Role] = {
    role.name: role
    for role in (
        Role(
            'displacement',
            PISTON_STATE,
            JOINT_STATE,
            'length',
            'position [m] of the joint `piston` (parameter `joint`); +x grows cylinder A, shrinks B',
        ),
        Role(
            'pressure',
            f'{EITHER}/pressure',
            FLUID_PRESSURE,
            'pressure',
            "absolute pressure [Pa], with the sample's stamp",
        ),
        Role(
            'setpoint',
            f'{EITHER}/setpoint',
            FLOAT64,
            'pressure',
            'set pressure of the regulator, gauge [Pa]; acts from the next sample on',
            held=True,
            gauge=True,
        ),
        Role(
            'setpoint_applied',
            f'{EITHER}/setpoint_applied',
            FLUID_PRESSURE,
            'pressure',
            'set-point that acted up to the sample, absolute [Pa]',
        ),
        Role(
            'force',
            MEASURED_FORCE,
            WRENCH_STAMPED,
            'force',
            'contact force [N] that a load cell reads, along the parameter `axis`, or x where a node has none',
        ),
    )
}
"""By their names. One that no field of a `Recording` is for stands in its `others`."""


def pressure_topic(cylinder: str) -> str:
    """Return the topic of a cylinder's pressure."""
    return ROLES['pressure'].topic_of(cylinder)


def setpoint_topic(cylinder: str) -> str:
    """Return the topic of a regulator's set pressure."""
    return ROLES['setpoint'].topic_of(cylinder)


def setpoint_applied_topic(cylinder: str) -> str:
    """Return the topic of the set-point that acted up to a sample."""
    return ROLES['setpoint_applied'].topic_of(cylinder)


def residual_topic(name: str) -> str:
    """Return the topic of what is measured less what the model predicts, of a cylinder or of `CONTACT_FORCE`."""
    return f'{name}/residual'


MODEL_INPUTS = (PISTON_STATE, *map(setpoint_topic, CYLINDERS))
"""What drives the model, and so is read from the device."""

SIM_INPUTS = (*MODEL_INPUTS, FORCE_SETPOINT)
"""What `sim_node` hears."""

MONITOR_INPUTS = (*MODEL_INPUTS, *map(pressure_topic, CYLINDERS), MEASURED_FORCE)
"""What `monitor_node` hears."""

TOPICS = {
    **{role.topic: role.meaning for role in ROLES.values()},
    PISTON_COMMAND: 'displacement that the rig moves its piston to [m]',
    residual_topic(EITHER): 'measured less predicted pressure, a difference [Pa]',
    FORCE_SETPOINT: 'desired contact force [N], made a pair of set-points about `bias_pressure`; the last writer wins',
    CONTACT_FORCE: 'contact force [N] that the pressures make, along `axis` of `frame_id`',
    residual_topic(CONTACT_FORCE): 'measured less predicted contact force [N]',
    RESULT: 'report.json of the last identification; latched: who comes later gets it too',
    DIAGNOSTICS: 'state of the node, counts, and in words what is wrong',
}
"""What each topic carries, with its unit."""

_TYPES = {
    **{role.topic: role.msgtype for role in ROLES.values()},
    residual_topic(EITHER): FLUID_PRESSURE,
    PISTON_COMMAND: FLOAT64,
    FORCE_SETPOINT: FLOAT64,
    CONTACT_FORCE: WRENCH_STAMPED,
    residual_topic(CONTACT_FORCE): WRENCH_STAMPED,
}


def expected_type(topic: str) -> str | None:
    """Return the message type of a topic of the convention, given in any namespace; None of another topic."""
    name = f'/{topic}'
    for cylinder in CYLINDERS:
        name = name.replace(f'/{cylinder}/', f'/{EITHER}/')
    return next((msgtype for known, msgtype in _TYPES.items() if name.endswith(f'/{known}')), None)


_BELOW = {PREDICTED: 'predicted: ', PREVIEW: 'while `piston_state` is silent, with the piston held: '}


def meaning(topic: str) -> str:
    """
    Return what a topic carries, by its name without the device's namespace.

    Raises
    ------
    KeyError
        If it is no topic of ours.

    """
    below = next((below for below in _BELOW if topic.startswith(below)), '')
    name = topic[len(below) :]
    for cylinder in CYLINDERS:
        name = name.replace(cylinder, EITHER)
    return _BELOW.get(below, '') + TOPICS[name]
