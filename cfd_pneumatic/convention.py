"""
Names that the nodes, the recordings and the rig agree on.

Topic names are relative: a namespace tells the real device (``/cfd/device``) from its simulator (``/cfd/sim``).
"""

CYLINDERS = ('cylinder_a', 'cylinder_b')
"""Cylinder A grows with +x, cylinder B shrinks."""

PISTON_STATE = 'piston_state'
"""sensor_msgs/JointState: piston displacement [m]."""

PISTON_JOINT = 'piston'
"""Default name of the joint in `PISTON_STATE`."""

FORCE_SETPOINT = 'force_setpoint'
"""std_msgs/Float64: desired contact force [N]."""

CONTACT_FORCE = 'contact_force'
"""geometry_msgs/WrenchStamped: contact force derived from the pressures [N]."""

MEASURED_FORCE = 'measured_force'
"""geometry_msgs/WrenchStamped: contact force measured by a load cell [N]."""

PREDICTED = 'predicted/'
"""What the monitor's model predicts is published below this name, under the names that it is measured by."""

PISTON_COMMAND = 'piston_command'
"""std_msgs/Float64: displacement that the rig's piston is moved to [m]."""

AMBIENT_PRESSURE = 101_325.0
"""Default ambient pressure, absolute [Pa]."""


SUPPLY_PRESSURE = 517_106.8
"""Default supply pressure, gauge: 75 psi, as the paper has it [Pa]. A set-point above it is refused."""

PISTON_AREA = 1.14e-3
"""Default area of either piston [m^2]."""

SCHEDULE_COLUMNS = ('time_s', 'displacement_m', 'velocity_m_per_s', 'cylinder_a_setpoint_pa', 'cylinder_b_setpoint_pa')
"""Head of a schedule in a file: set-points are gauge and hold from their time on."""


def pressure_topic(cylinder: str) -> str:
    """Return the topic of a cylinder's pressure: sensor_msgs/FluidPressure, absolute [Pa]."""
    return f'{cylinder}/pressure'


def setpoint_topic(cylinder: str) -> str:
    """Return the topic of a regulator's set pressure: std_msgs/Float64, gauge [Pa]."""
    return f'{cylinder}/setpoint'


def setpoint_applied_topic(cylinder: str) -> str:
    """Return the topic of the set-point that acted up to a sample: sensor_msgs/FluidPressure, absolute [Pa]."""
    return f'{cylinder}/setpoint_applied'


def residual_topic(name: str) -> str:
    """
    Return the topic of what is measured less what the model predicts, of a cylinder or of `CONTACT_FORCE`.

    sensor_msgs/FluidPressure, a difference [Pa]; geometry_msgs/WrenchStamped [N].
    """
    return f'{name}/residual'


MODEL_INPUTS = (PISTON_STATE, *map(setpoint_topic, CYLINDERS))
"""What drives the model, and so is read from the device."""

SIM_INPUTS = (*MODEL_INPUTS, FORCE_SETPOINT)
"""What `sim_node` hears."""

MONITOR_INPUTS = (*MODEL_INPUTS, *map(pressure_topic, CYLINDERS), MEASURED_FORCE)
"""What `monitor_node` hears."""
