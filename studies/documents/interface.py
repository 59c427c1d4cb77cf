# SPDX-License-Identifier: Apache-2.0
"""
Every program, topic, service and parameter: make interface-document writes docs/interface.md, and the pages of help.

Nodes are started and asked: parameters come from their descriptors, topics and services from what they have opened.
"""

from __future__ import annotations

import argparse
import importlib
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cfd_pneumatic.convention import CYLINDERS, EITHER, SCHEDULE_COLUMNS, meaning
from cfd_pneumatic.files import write_text
from cfd_pneumatic.model import EFFECTS, FORCE_PARTS, GENERIC
from cfd_pneumatic.planning import PLAN_FILE, SCHEDULE_FILE
from cfd_pneumatic.plant import COLUMNS, CSV_FILE, PARQUET_FILE
from cfd_pneumatic.reporting import PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.runtime import HELP
from cfd_pneumatic.units import PSI, PSI_PER_INCH
from studies.documents import mapping as mapping_document
from studies.documents.help_pages import node_class, pages
from studies.documents.markdown import code, table
from studies.documents.package_facts import programs
from studies.tools.provenance import ROOT
from studies.tools.ros_environment import isolate

DOCUMENT = ROOT / 'docs' / 'interface.md'
NAMESPACE = '/device'
NODE, COMMAND = '_node', '.commands.'
BESIDE = {'Pa': (PSI, 'psi'), 'Pa/m': (PSI_PER_INCH, 'lbf/in^3')}
"""What stands beside SI: for its unit a factor, and a name."""

LEAST_BESIDE = 1e3
"""Values below are not said in another unit."""

OF_EVERY_NODE = re.compile(r'qos_overrides\.|use_sim_time$|start_type_description_service$')
"""Parameters that rclpy declares."""

OF_ROS = re.compile(r'/rosout$|/parameter_events$')
SERVICES_OF_ROS = re.compile(r'/(\w+_parameters(_atomically)?|get_parameter_types|get_type_description)$')

MUST = {'recorder_node': ('topics', 'output')}
"""Parameters without which a node does not start."""


class Entry(NamedTuple):
    """A parameter's row in a table, but for its name."""

    kind: str
    default: str
    range: str
    changes: str
    meaning: str


Entries = dict[str, Entry]


class Opened(NamedTuple):
    """A topic's row in a table, but for its name."""

    message: str
    qos: str
    direction: str


def document() -> str:
    """Return the document in Markdown."""
    with tempfile.TemporaryDirectory() as folder, _nodes(Path(folder)) as nodes:
        return '\n\n'.join([*_opening(), *_programs(), *_topics(nodes), *_parameters(nodes), *_files()]) + '\n'


def _opening() -> Iterator[str]:
    yield '# Interface'
    yield (
        'Every program, topic, service and parameter, as the running nodes tell them. Written by `make '
        'interface-document`; a test holds it to the code. What the model means by its parameters stands in '
        '[model.md](model.md), what an effect is in [effects.md](effects.md).'
    )


# programs


def _programs() -> Iterator[str]:
    modules = {name: importlib.import_module(module) for name, module in programs().items()}
    yield '## Programs'
    rows = []
    for name, module in sorted(modules.items(), key=lambda one: (not one[0].endswith(NODE), one[0])):
        _, _, summary = str(module.__doc__).strip().splitlines()[0].partition(': ')
        path = f'{module.__name__.replace(".", "/")}.py'
        rows.append([f'[`{name}`](../{path})', 'node' if name.endswith(NODE) else 'command', summary])
    yield table(['program', 'kind', 'what it is'], rows)
    yield (
        'A node is started with `ros2 run cfd_pneumatic NAME --ros-args -p PARAMETER:=VALUE`. Bad input is one line on '
        'standard error and exit code 2; a command that was interrupted ends with 130.'
    )
    for name, module in sorted(modules.items()):
        if COMMAND in module.__name__:
            yield from _command(name, module.make_parser())


def _command(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    yield f'### `{name}`'
    yield str(parser.description)
    rows = []
    formatter = parser._get_formatter()
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction) and action.help is not argparse.SUPPRESS:
            given = [*action.option_strings[-1:], formatter._format_args(action, action.dest.upper())]
            said = formatter._expand_help(action)
            rows.append([code(' '.join(given).strip()), 'required' if action.required else '', ' '.join(said.split())])
    yield table(['argument', '', 'meaning'], rows)


# nodes


@contextmanager
def _nodes(folder: Path) -> Iterator[dict[str, list[Node]]]:
    """Yield every node by its program's name, the rig with a schedule too, in a namespace and a graph of their own."""
    given: dict[str, list[dict[str, Any]]] = {
        'recorder_node': [dict(zip(MUST['recorder_node'], (['/topic'], str(folder / 'bag'))))],
        'rig_node': [{}, {'schedule': 'out_and_back'}],
    }
    context = Context()
    rclpy.init(context=context, args=['--ros-args', '--log-level', 'error'])
    nodes: dict[str, list[Node]] = {}
    try:
        for name, module in programs().items():
            if name.endswith(NODE):
                make = node_class(importlib.import_module(module))
                for parameters in given.get(name, [{}]):
                    overrides = [Parameter(one, value=value) for one, value in parameters.items()]
                    node = make(context=context, namespace=NAMESPACE, parameter_overrides=overrides)
                    nodes.setdefault(name, []).append(node)
        yield nodes
    finally:
        for node in (one for some in nodes.values() for one in some):
            node.destroy_node()
        rclpy.shutdown(context=context)


# topics and services


def _topics(nodes: Mapping[str, Sequence[Node]]) -> Iterator[str]:
    yield '## Topics and services'
    yield (
        f'Names are relative but for those that begin with `/`: a namespace tells the device from its simulator. `~` '
        f'is the name of the node, `{EITHER}` is {" and ".join(f"`{name}`" for name in CYLINDERS)}, of which '
        '`sim_node` and `monitor_node` open only those with `cylinder_*.enabled`. *Depth* is the length of the '
        'queue in messages. QoS can be overridden by parameters: '
        '`qos_overrides./cfd/sim/piston_state.subscription.reliability`, and so on.'
    )
    for name, some in sorted(nodes.items()):
        yield f'### `{name}`: topics'
        opened = [_opened(node) for node in some]
        if any(opened):
            yield table(['topic', 'type', 'QoS', 'direction', 'meaning'], _topic_rows(opened))
        else:
            yield 'Those that its parameter `topics` names, with as much reliability as their publishers offer.'
        services = [
            [code(_relative(service.service_name, some[0])), _type(service.srv_type), service.callback.__doc__]
            for service in some[0].services
            if not SERVICES_OF_ROS.search(service.service_name)
        ]
        if services:
            yield table(['service', 'type', 'what it does'], services)


def _opened(node: Node) -> dict[str, Opened]:
    """Return what a node has opened, by its name with either cylinder's folded into one."""
    directions: list[tuple[str, list[Any]]] = [('in', list(node.subscriptions)), ('out', list(node.publishers))]
    return {
        _relative(one.topic_name, node): Opened(_type(one.msg_type), _qos(one.qos_profile), direction)
        for direction, some in directions
        for one in some
        if not OF_ROS.search(one.topic_name)
    }


def _topic_rows(opened: Sequence[Mapping[str, Opened]]) -> list[list[str]]:
    """Return a row for each topic; the second of two ways to run a node is with a schedule."""
    rows: dict[str, list[str]] = {}
    for topic in dict.fromkeys(topic for some in opened for topic in some):
        ways = [some.get(topic) for some in opened]
        present = [way for way in ways if way is not None]
        if len(set(ways)) == 1:
            direction = present[0].direction
        else:
            when = ('without a `schedule`', 'with a `schedule`')
            direction = ', '.join(f'{way.direction} {word}' for way, word in zip(ways, when) if way is not None)
        qos = '; '.join(dict.fromkeys(way.qos for way in present))
        folded = _folded(topic)
        rows[folded] = [code(folded), present[0].message, qos, direction, meaning(topic)]
    return list(rows.values())


def _relative(name: str, node: Node) -> str:
    """Return a name as the code has it."""
    return name.replace(f'{node.get_fully_qualified_name()}/', '~/').removeprefix(f'{NAMESPACE}/')


def _type(message: Any) -> str:
    package, kind, *_ = message.__module__.split('.')
    return f'{package}/{kind}/{message.__name__}'


def _qos(qos: QoSProfile) -> str:
    reliability = 'best effort' if qos.reliability == ReliabilityPolicy.BEST_EFFORT else 'reliable'
    latched = ['transient local'] if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL else []
    return ', '.join([reliability, *latched, f'depth {qos.depth}'])


# parameters


def _parameters(nodes: Mapping[str, Sequence[Node]]) -> Iterator[str]:
    yield '## Parameters'
    yield (
        '*Live*: `ros2 param set` acts on the running node, or is refused with the reason. *At start*: read-only. '
        f"`{EITHER}` is either cylinder. Where a number is asked for write 1.0 for 1. Every node has ROS 2's own "
        'parameters too, as `use_sim_time`.'
    )
    entries = {name: _entries(some[0]) for name, some in nodes.items()}
    models = ('sim_node', 'monitor_node')
    shared = {name: entry for name, entry in entries[models[0]].items() if entries[models[1]].get(name) == entry}
    effects = {name: entry for name, entry in shared.items() if name.count('.') == 2}
    yield '### `sim_node` and `monitor_node`: parameters'
    yield _table({name: entry for name, entry in shared.items() if name not in effects})
    for name, own in entries.items():
        rest = {one: entry for one, entry in own.items() if name not in models or one not in shared}
        yield f'### `{name}`: parameters'
        yield from ['Those above, and:'] if name in models else []
        yield _table(rest)
    yield from _effects(effects)


def _entries(node: Node) -> Entries:
    """Return the rows of a node's parameters, both cylinders' as one where they are alike."""
    parameters: Any = node.get_parameters_by_prefix('')
    rows = {
        name: _entry(node.describe_parameter(name), parameter.value)
        for name, parameter in parameters.items()
        if not OF_EVERY_NODE.match(name)
    }
    for name in MUST.get(node.get_name(), ()):
        rows[name] = rows[name]._replace(default='required')
    one, other = CYLINDERS
    assert all(rows.get(name.replace(one, other)) == row for name, row in rows.items() if one in name)
    return {_folded(name): row for name, row in rows.items()}


def _entry(descriptor: ParameterDescriptor, value: Any) -> Entry:
    said = re.fullmatch(r'(.*?)(?: \[([^\[\]]+)\])?', descriptor.description, re.DOTALL)
    assert said is not None
    unit = said[2] or ''
    bounds = [*descriptor.floating_point_range, *descriptor.integer_range]
    limits = [f'{one.from_value:g} to {one.to_value:g} {unit}'.rstrip(' -') for one in bounds]
    return Entry(
        Parameter.Type(descriptor.type).name.lower().replace('_array', '[]'),
        _said(value, unit),
        '; '.join([*limits, *filter(None, [descriptor.additional_constraints])]),
        'at start' if descriptor.read_only else 'live',
        said[1],
    )


def _said(value: Any, unit: str) -> str:
    """Return a default with its unit, and in the unit beside SI where it is large enough to mean something there."""
    numbers = value if isinstance(value, list) else [value]
    if isinstance(numbers[0], bool):
        return str(value).lower()
    if isinstance(numbers[0], str):
        return code(repr(value))
    text = f'{", ".join(f"{number:.6g}" for number in numbers)} {unit}'.rstrip(' -')
    if unit in BESIDE and any(abs(number) >= LEAST_BESIDE for number in numbers):
        factor, name = BESIDE[unit]
        text += f' ({", ".join(f"{number / factor:.4g}" for number in numbers)} {name})'
    return text


def _folded(name: str) -> str:
    return re.sub('|'.join(CYLINDERS), EITHER, name)


def _table(entries: Mapping[str, Entry]) -> str:
    return table(
        ['parameter', 'type', 'default', 'range', 'changes', 'meaning'],
        ([code(name), *entry] for name, entry in sorted(entries.items())),
    )


def _effects(entries: Entries) -> Iterator[str]:
    yield '### Effects of `sim_node` and `monitor_node`: parameters'
    yield (
        'Each effect has a switch, `PREFIX.EFFECT.enabled` (bool, false, live), and the parameters below it, as '
        '`cylinder_a.leakage.conductance`. All are doubles and live; by default they change nothing.'
    )
    known = {**EFFECTS, **GENERIC}
    for prefix, some in ((EITHER, known.keys() - FORCE_PARTS.keys()), ('contact_force', FORCE_PARTS.keys())):
        rows = []
        for effect in sorted(some):
            label = f'[`{effect}`]({f"effects.md#{effect}" if effect in EFFECTS else "model.md#the-loop"})'
            for name, entry in entries.items():
                if name.startswith(f'{prefix}.{effect}.') and not name.endswith('.enabled'):
                    _, _, what = entry.meaning.partition(f'{known[effect].description}: ')
                    rows.append([label, code(name.rpartition('.')[2]), entry.default, entry.range, what])
                    label = ''
        yield table([f'`{prefix}.`', 'parameter', 'default', 'range', 'meaning'], rows)


# files


def _files() -> Iterable[str]:
    yield '## Files'
    yield (
        f'`{REPORT_FILE}` of `identify_bag` and `{PLAN_FILE}` of `plan_experiment` are JSON whose keys end in their '
        'units; [`data.py`: `report_data`](../cfd_pneumatic/reporting/data.py) and [`report.py`: `plan_data`]'
        f'(../cfd_pneumatic/planning/report.py) make them. `{PARAMETER_FILE}` holds parameters of `sim_node`, as above.'
    )
    columns = ', '.join(map(code, SCHEDULE_COLUMNS))
    yield f'Columns of `{SCHEDULE_FILE}`, set-points gauge and holding from their time on: {columns}.'
    yield f'Columns of `{CSV_FILE}` and `{PARQUET_FILE}`, which `identify_bag --each` writes:'
    yield table(
        ['column', 'kind', 'unit', 'meaning'],
        ([code(one.name), one.kind, one.unit, one.description] for one in COLUMNS),
    )


def main() -> None:
    """Write the documents and the pages."""
    isolate()
    write_text(DOCUMENT, document())
    write_text(mapping_document.DOCUMENT, mapping_document.document())
    for name, page in pages().items():
        write_text(HELP / f'{name}.txt', page)
    print(f'{DOCUMENT}, {mapping_document.DOCUMENT} and {HELP}')


if __name__ == '__main__':
    main()
