"""
What each node of a cell may do, for SROS 2: make security-policies writes config/cell.policy.xml.

Least permission: a node may publish, hear, answer and ask what it does in `cell.launch.py` and `identify.launch.py`,
and nothing else. A test holds it to the nodes as they run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

from cfd_pneumatic import convention
from cfd_pneumatic.convention import CYLINDERS, PREDICTED, PREVIEW
from cfd_pneumatic.files import write_text
from studies.package_facts import ROOT

FILE = ROOT / 'config' / 'cell.policy.xml'
CELL = '/cfd'
DEVICE, SIM, MONITOR = (f'{CELL}/{role}' for role in ('device', 'sim', 'monitor'))

PARAMETER_SERVICES = (
    'describe_parameters',
    'get_parameter_types',
    'get_parameters',
    'list_parameters',
    'set_parameters',
    'set_parameters_atomically',
)
OF_EVERY_NODE = (*PARAMETER_SERVICES, 'get_type_description')
"""Services that rclpy answers in every node."""

PRESSURES = tuple(map(convention.pressure_topic, CYLINDERS))
APPLIED = tuple(map(convention.setpoint_applied_topic, CYLINDERS))
SETPOINTS = tuple(map(convention.setpoint_topic, CYLINDERS))
RESIDUALS = tuple(map(convention.residual_topic, (*CYLINDERS, convention.CONTACT_FORCE)))
ANSWERS = (*PRESSURES, convention.CONTACT_FORCE)


@dataclass(frozen=True)
class Profile:
    """
    What a node may do.

    Attributes
    ----------
    program, namespace
        Of the node.
    publishes, hears
        Topics, absolute.
    answers, asks
        Services: its own by their last names, others absolute.

    """

    program: str
    namespace: str
    publishes: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The node's full name, by which its own topics and services begin."""
        return f'{self.namespace}/{self.program}'

    def rules(self) -> Iterator[tuple[str, str, list[str]]]:
        """Yield kind, right, and the names that it is given for; every node's own things too."""
        yield 'topics', 'publish', sorted({*self.publishes, '/rosout', '/parameter_events'})
        yield 'topics', 'subscribe', sorted({*self.hears, '/clock'})
        yield 'services', 'reply', sorted(f'{self.name}/{name}' for name in (*self.answers, *OF_EVERY_NODE))
        if self.asks:
            yield 'services', 'request', sorted(self.asks)


def below(namespace: str, topics: Iterable[str]) -> tuple[str, ...]:
    """Return topics in a namespace."""
    return tuple(f'{namespace}/{topic}' for topic in topics)


PROFILES = (
    Profile(
        'rig_node',
        DEVICE,
        publishes=below(DEVICE, (convention.PISTON_STATE, *PRESSURES, *APPLIED, *SETPOINTS, convention.MEASURED_FORCE)),
        hears=below(DEVICE, (convention.PISTON_COMMAND, *SETPOINTS)),
    ),
    Profile(
        'sim_node',
        SIM,
        publishes=(
            *below(SIM, (*ANSWERS, *APPLIED, *(PREVIEW + topic for topic in ANSWERS))),
            convention.DIAGNOSTICS,
        ),
        hears=below(DEVICE, convention.SIM_INPUTS),
        answers=('reset',),
    ),
    Profile(
        'monitor_node',
        MONITOR,
        publishes=(
            *below(MONITOR, (*RESIDUALS, *(PREDICTED + topic for topic in (*ANSWERS, *APPLIED)))),
            convention.DIAGNOSTICS,
        ),
        hears=below(DEVICE, convention.MONITOR_INPUTS),
        answers=('learn',),
    ),
    Profile(
        'identifier_node',
        CELL,
        publishes=(f'{CELL}/identifier_node/result', convention.DIAGNOSTICS),
        answers=('identify', 'cancel', 'revert'),
        asks=tuple(f'{SIM}/sim_node/{service}' for service in ('get_parameters', 'set_parameters_atomically')),
    ),
    Profile(
        'recorder_node',
        CELL,
        hears=(
            *below(DEVICE, (convention.PISTON_STATE, *PRESSURES, *APPLIED, *SETPOINTS, convention.MEASURED_FORCE)),
            *below(SIM, (*ANSWERS, *APPLIED)),
        ),
    ),
)
"""All nodes of a cell; `rig_node` stands for the device's own drivers."""


def policy() -> str:
    """Return the policy file of a cell, in the format of SROS 2, version 0.2.0."""
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for profile in PROFILES:
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'{CELL}/{profile.program}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        rules = ElementTree.SubElement(profiles, 'profile', ns=profile.namespace, node=profile.program)
        for kind, right, names in profile.rules():
            allowed = ElementTree.SubElement(rules, kind, {right: 'ALLOW'})
            for name in names:
                ElementTree.SubElement(allowed, kind[:-1]).text = name
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


if __name__ == '__main__':
    write_text(FILE, policy())
