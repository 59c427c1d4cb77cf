# SPDX-License-Identifier: Apache-2.0
"""
Names and defaults that nodes, recordings and rig share.

Topic names are relative; the namespace distinguishes the real device (``/cfd/device``) from its simulator
(``/cfd/sim``). Each recorded signal is a row of `ROLES`, which all code that handles signals uses.
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
"""Prefix of the topics of predictions, which have the names of the measured topics."""

PREVIEW = 'preview/'
"""Prefix of the topics of pressures and force while no piston sample arrives."""

AMBIENT_PRESSURE = 101_325.0
"""Default ambient pressure, absolute [Pa]."""

AMBIENT_PRESSURES = (1e4, 2e5)
"""The lowest and the highest plausible ambient pressure, absolute [Pa]."""

SUPPLY_PRESSURE = 517_106.8
"""Default supply pressure, gauge, of the paper: 75 psi [Pa]. A set-point above the supply pressure is refused."""

PISTON_AREA = 1.14e-3
"""Default area of either piston [m^2]."""

AREAS = (1e-6, 1.0)
"""The smallest and the largest plausible area of a piston [m^2]."""

FACTORS = (-1e3, 1e3)
"""The smallest and the largest plausible geometric factor, contact force / piston force [-]."""

SCHEDULE_COLUMNS = ('time_s', 'displacement_m', 'velocity_m_per_s', 'cylinder_a_setpoint_pa', 'cylinder_b_setpoint_pa')
"""Header of a schedule in a file; set-points are gauge and hold from their time on."""


JOINT_STATE = 'sensor_msgs/msg/JointState'
FLUID_PRESSURE = 'sensor_msgs/msg/FluidPressure'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
FLOAT64 = 'std_msgs/msg/Float64'

EITHER = 'cylinder_*'
"""Placeholder for the name of a cylinder in names and texts for both cylinders."""


@dataclass(frozen=True)
class Role:
    """
    Meaning and topic of a recorded signal.

    Attributes
    ----------
    name : str
        Name in mappings and messages for people.
    topic : str
        Topic, with `EITHER` in place of a cylinder's name.
    msgtype : str
        Type of the messages.
    quantity : str
        `length`, `pressure` or `force`.
    meaning : str
        Content of the topic, with its unit.
    held : bool
        Whether a value holds until the next value.
    gauge : bool
        Whether pressures in messages are gauge pressures.

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
        """Whether each cylinder has such a signal."""
        return EITHER in self.topic

    def topic_of(self, cylinder: str | None = None) -> str:
        """Return the topic; that of a cylinder if each cylinder has such a signal."""
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
            'contact force [N] of a load cell, along the parameter `axis`, or along x in a node without `axis`',
        ),
    )
}
"""Roles by name. A signal without a field of `Recording` is in `Recording.others`."""


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
    """Return the topic of measured minus predicted values, of a cylinder or of `CONTACT_FORCE`."""
    return f'{name}/residual'


MODEL_INPUTS = (PISTON_STATE, *map(setpoint_topic, CYLINDERS))
"""Topics of the model's inputs, which are read from the device."""

SIM_INPUTS = (*MODEL_INPUTS, FORCE_SETPOINT)
"""Topics to which `sim_node` subscribes."""

MONITOR_INPUTS = (*MODEL_INPUTS, *map(pressure_topic, CYLINDERS), MEASURED_FORCE)
"""Topics to which `monitor_node` subscribes."""

TOPICS = {
    **{role.topic: role.meaning for role in ROLES.values()},
    PISTON_COMMAND: "target displacement of the rig's piston [m]",
    residual_topic(EITHER): 'measured minus predicted pressure, a difference [Pa]',
    FORCE_SETPOINT: 'desired contact force [N], converted to set-points about `bias_pressure`; the last message wins',
    CONTACT_FORCE: 'contact force [N] of the pressures, along `axis` of `frame_id`',
    residual_topic(CONTACT_FORCE): 'measured minus predicted contact force [N]',
    RESULT: 'report.json of the last identification; latched, so that late subscribers receive it',
    DIAGNOSTICS: 'state of the node, counts, and a message about each fault',
}
"""Content of each topic, with its unit."""

_TYPES = {
    **{role.topic: role.msgtype for role in ROLES.values()},
    residual_topic(EITHER): FLUID_PRESSURE,
    PISTON_COMMAND: FLOAT64,
    FORCE_SETPOINT: FLOAT64,
    CONTACT_FORCE: WRENCH_STAMPED,
    residual_topic(CONTACT_FORCE): WRENCH_STAMPED,
}


def expected_type(topic: str) -> str | None:
    """Return the message type of a topic of the convention in any namespace; None for another topic."""
    name = f'/{topic}'
    for cylinder in CYLINDERS:
        name = name.replace(f'/{cylinder}/', f'/{EITHER}/')
    return next((msgtype for known, msgtype in _TYPES.items() if name.endswith(f'/{known}')), None)


_PREFIX_MEANINGS = {PREDICTED: 'predicted: ', PREVIEW: 'while no `piston_state` arrives, with the piston at rest: '}


def meaning(topic: str) -> str:
    """
    Return the content of a topic, by its name without the device's namespace.

    Raises
    ------
    KeyError
        If the topic is not part of the convention.

    """
    prefix = next((prefix for prefix in _PREFIX_MEANINGS if topic.startswith(prefix)), '')
    name = topic[len(prefix) :]
    for cylinder in CYLINDERS:
        name = name.replace(cylinder, EITHER)
    return _PREFIX_MEANINGS.get(prefix, '') + TOPICS[name]
