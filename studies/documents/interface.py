# SPDX-License-Identifier: Apache-2.0
"""
Document every program, topic, service and parameter: `make interface-document`.

The command writes docs/reference/interface.md and the pages of --help.

The nodes are started. Their descriptors give the parameters; their publishers, subscriptions and services the topics.
"""

from __future__ import annotations

import argparse
import importlib
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
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
from cfd_pneumatic.path import BAG_FILE, PREVIEW_FILE
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

DOCUMENT = ROOT / 'docs' / 'reference' / 'interface.md'
NAMESPACE = '/device'
NODE, COMMAND = '_node', '.commands.'
SECOND_UNITS = {'Pa': (PSI, 'psi'), 'Pa/m': (PSI_PER_INCH, 'lbf/in^3')}
"""For an SI unit: factor and name of a second unit in which values are shown."""

LEAST_IN_SECOND_UNIT = 1e3
"""Smallest value that is also shown in the second unit [SI]."""

OF_EVERY_NODE = re.compile(r'qos_overrides\.|use_sim_time$|start_type_description_service$')
"""Parameters that rclpy declares in every node."""

OF_ROS = re.compile(r'/rosout$|/parameter_events$')
SERVICES_OF_ROS = re.compile(r'/(\w+_parameters(_atomically)?|get_parameter_types|get_type_description)$')

LOOP = '../explanation/loop.md'
"""Page that explains the effects that are estimated curves."""

MUST = {'recorder_node': ('topics', 'output')}
"""Parameters without which a node does not start."""


class Entry(NamedTuple):
    """Cells of a parameter's row, without the name."""

    kind: str
    default: str
    range: str
    changes: str
    meaning: str


Entries = dict[str, Entry]


class Endpoint(NamedTuple):
    """Cells of a topic's row, without the name and the meaning."""

    message: str
    qos: str
    direction: str


def document() -> str:
    """Return docs/reference/interface.md: every program, topic, service and parameter."""
    with tempfile.TemporaryDirectory() as folder, _nodes(Path(folder)) as nodes:
        return '\n\n'.join([*_opening(), *_programs(), *_topics(nodes), *_parameters(nodes), *_files()]) + '\n'


def _opening() -> Iterator[str]:
    yield '# Interface'
    yield (
        'Programs, topics, services and parameters, written by `make interface-document`. '
        '[model.md](../explanation/model.md) explains the parameters of the model, [effects.md](effects.md) the '
        'effects.'
    )


# programs


def _programs() -> Iterator[str]:
    modules = {name: importlib.import_module(module) for name, module in programs().items()}
    yield '## Programs'
    rows = []
    for name, module in sorted(modules.items(), key=lambda item: (not item[0].endswith(NODE), item[0])):
        _, _, summary = str(module.__doc__).strip().splitlines()[0].partition(': ')
        path = f'{module.__name__.replace(".", "/")}.py'
        rows.append([f'[`{name}`](../../{path})', 'node' if name.endswith(NODE) else 'command', summary])
    yield table(['program', 'kind', 'purpose'], rows)
    yield (
        'Start a node with `ros2 run cfd_pneumatic NAME --ros-args -p PARAMETER:=VALUE`. Bad input ends a program with '
        'one line on standard error and exit code 2, an interrupt with exit code 130.'
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
            argument = [*action.option_strings[-1:], formatter._format_args(action, action.dest.upper())]
            text = formatter._expand_help(action)
            rows.append(
                [code(' '.join(argument).strip()), 'required' if action.required else '', ' '.join(text.split())]
            )
    yield table(['argument', '', 'meaning'], rows)


# nodes


@contextmanager
def _nodes(folder: Path) -> Iterator[dict[str, list[Node]]]:
    """Yield every node by its program's name in a separate graph; the rig also with a schedule."""
    parameter_sets: dict[str, list[dict[str, Any]]] = {
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
                for parameters in parameter_sets.get(name, [{}]):
                    overrides = [Parameter(key, value=value) for key, value in parameters.items()]
                    node = make(context=context, namespace=NAMESPACE, parameter_overrides=overrides)
                    nodes.setdefault(name, []).append(node)
        yield nodes
    finally:
        for program_nodes in nodes.values():
            for node in program_nodes:
                node.destroy_node()
        rclpy.shutdown(context=context)


# topics and services


def _topics(nodes: Mapping[str, Sequence[Node]]) -> Iterator[str]:
    yield '## Topics and services'
    yield (
        f'Names without a leading `/` are relative to the namespace of the node, `~` is the name of the node. '
        f'`{EITHER}` is {" and ".join(f"`{name}`" for name in CYLINDERS)}, if `cylinder_*.enabled`. *Depth* is the '
        'length of the queue in messages. Parameters such as '
        '`qos_overrides./cfd/sim/piston_state.subscription.reliability` override the QoS.'
    )
    for name, program_nodes in sorted(nodes.items()):
        yield f'### `{name}`: topics'
        endpoints = [_endpoints(node) for node in program_nodes]
        if any(endpoints):
            yield table(['topic', 'type', 'QoS', 'direction', 'meaning'], _topic_rows(endpoints))
        else:
            yield 'The topics of its parameter `topics`, with the reliability that their publishers offer.'
        services = [
            [code(_relative(service.service_name, node)), _type(service.srv_type), _purpose(service.callback)]
            for node in program_nodes[:1]
            for service in node.services
            if not SERVICES_OF_ROS.search(service.service_name)
        ]
        if services:
            yield table(['service', 'type', 'what it does'], services)


def _purpose(callback: Any) -> str:
    """Return the first line of a callback's docstring; `BoundedNode` wraps callbacks."""
    while isinstance(callback, partial):
        (callback,) = callback.args
    return str(callback.__doc__).strip().splitlines()[0]


def _endpoints(node: Node) -> dict[str, Endpoint]:
    """Return the endpoints of a node by their relative names."""
    directions: list[tuple[str, list[Any]]] = [('in', list(node.subscriptions)), ('out', list(node.publishers))]
    return {
        _relative(endpoint.topic_name, node): Endpoint(_type(endpoint.msg_type), _qos(endpoint.qos_profile), direction)
        for direction, node_endpoints in directions
        for endpoint in node_endpoints
        if not OF_ROS.search(endpoint.topic_name)
    }


def _topic_rows(endpoints_of_runs: Sequence[Mapping[str, Endpoint]]) -> list[list[str]]:
    """Return a row for each topic; the second of two runs of a node has a schedule."""
    rows: dict[str, list[str]] = {}
    for topic in dict.fromkeys(topic for endpoints in endpoints_of_runs for topic in endpoints):
        alternatives = [endpoints.get(topic) for endpoints in endpoints_of_runs]
        present = [endpoint for endpoint in alternatives if endpoint is not None]
        if len(set(alternatives)) == 1:
            direction = present[0].direction
        else:
            conditions = ('without a `schedule`', 'with a `schedule`')
            direction = ', '.join(
                f'{endpoint.direction} {condition}'
                for endpoint, condition in zip(alternatives, conditions)
                if endpoint is not None
            )
        qos = '; '.join(dict.fromkeys(endpoint.qos for endpoint in present))
        folded = _folded(topic)
        rows[folded] = [code(folded), present[0].message, qos, direction, meaning(topic)]
    return list(rows.values())


def _relative(name: str, node: Node) -> str:
    """Return a topic's name relative to the node's namespace."""
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
        'Parameters that change *at run time* are set with `ros2 param set`. Write 1.0 instead of 1 for a number of '
        'type double. Every node also has the parameters of ROS 2, such as `use_sim_time`.'
    )
    entries = {name: _entries(some[0]) for name, some in nodes.items()}
    models = ('sim_node', 'monitor_node')
    shared = {name: entry for name, entry in entries[models[0]].items() if entries[models[1]].get(name) == entry}
    effects = {name: entry for name, entry in shared.items() if name.count('.') == 2}
    yield '### `sim_node` and `monitor_node`: parameters'
    yield _table({name: entry for name, entry in shared.items() if name not in effects})
    for name, node_entries in entries.items():
        further = {key: entry for key, entry in node_entries.items() if name not in models or key not in shared}
        yield f'### `{name}`: parameters'
        yield from ['The parameters above, and:'] if name in models else []
        yield _table(further)
    yield from _effects(effects)


def _entries(node: Node) -> Entries:
    """Return the rows of a node's parameters, with a common row for both cylinders."""
    parameters: Any = node.get_parameters_by_prefix('')
    rows = {
        name: _entry(node.describe_parameter(name), parameter.value)
        for name, parameter in parameters.items()
        if not OF_EVERY_NODE.match(name)
    }
    for name in MUST.get(node.get_name(), ()):
        rows[name] = rows[name]._replace(default='required')
    first, second = CYLINDERS
    assert all(rows.get(name.replace(first, second)) == row for name, row in rows.items() if first in name)
    return {_folded(name): row for name, row in rows.items()}


def _entry(descriptor: ParameterDescriptor, value: Any) -> Entry:
    description = re.fullmatch(r'(.*?)(?: \[([^\[\]]+)\])?', descriptor.description, re.DOTALL)
    assert description is not None
    unit = description[2] or ''
    bounds = [*descriptor.floating_point_range, *descriptor.integer_range]
    limits = [f'{bound.from_value:g} to {bound.to_value:g} {unit}'.rstrip(' -') for bound in bounds]
    return Entry(
        Parameter.Type(descriptor.type).name.lower().replace('_array', '[]'),
        _written(value, unit),
        '; '.join([*limits, *filter(None, [descriptor.additional_constraints])]),
        'at start' if descriptor.read_only else 'at run time',
        description[1],
    )


def _written(value: Any, unit: str) -> str:
    """Return a default with its unit, also in the second unit if the value is large enough."""
    numbers = value if isinstance(value, list) else [value]
    if isinstance(numbers[0], bool):
        return str(value).lower()
    if isinstance(numbers[0], str):
        return code(repr(value))
    text = f'{", ".join(f"{number:.6g}" for number in numbers)} {unit}'.rstrip(' -')
    if unit in SECOND_UNITS and any(abs(number) >= LEAST_IN_SECOND_UNIT for number in numbers):
        factor, name = SECOND_UNITS[unit]
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
        'Each effect has a switch, `PREFIX.EFFECT.enabled` (bool, false), and parameters such as '
        '`cylinder_a.leakage.conductance`. The parameters are doubles and change at run time; their defaults have no '
        'influence.'
    )
    known = {**EFFECTS, **GENERIC}
    for prefix, names in ((EITHER, known.keys() - FORCE_PARTS.keys()), ('contact_force', FORCE_PARTS.keys())):
        rows = []
        for effect in sorted(names):
            page = f'effects.md#{effect}' if effect in EFFECTS else f'{LOOP}#unknown-characteristics'
            label = f'[`{effect}`]({page})'
            for name, entry in entries.items():
                if name.startswith(f'{prefix}.{effect}.') and not name.endswith('.enabled'):
                    _, _, text = entry.meaning.partition(f'{known[effect].description}: ')
                    rows.append([label, code(name.rpartition('.')[2]), entry.default, entry.range, text])
                    label = ''
        yield table([f'`{prefix}.`', 'parameter', 'default', 'range', 'meaning'], rows)


# files


def _files() -> Iterable[str]:
    yield '## Files'
    yield (
        f'`{PREVIEW_FILE}` of `force_on_path` is JSON with units in the keys; '
        '[predict and hold the force](../how_to/predict_and_hold_the_force.md#what-the-files-contain) lists the keys. '
        f'`{BAG_FILE}` has the same signals as a bag.'
    )
    yield (
        f'`{REPORT_FILE}` of `identify_bag` and `{PLAN_FILE}` of `plan_experiment` are JSON with units in the keys, '
        'written by [`data.py`: `report_data`](../../cfd_pneumatic/reporting/data.py) and [`report.py`: `plan_data`]'
        f'(../../cfd_pneumatic/planning/report.py). `{PARAMETER_FILE}` has the parameters above.'
    )
    yield (
        f'Each channel of `{REPORT_FILE}` has the uncertainty of its model in `{PARAMETER_FILE}`. `covariance` has the '
        'names of the `parameters` and their `matrix`, in products of their units. Names are those of the estimates, '
        'heights of a curve (`curve.w0`) and `setpoint_offset`. Parameters that the fit held have no row. '
        '`model_error_pa` and `model_error_n` have the RMS error beyond the noise while the piston is at `rest` and in '
        '`motion`; null without such samples. They are of the part that the report judges. `per_step` is the error '
        'shortly after a step of the set-point, relative to the step, in all parts.'
    )
    columns = ', '.join(map(code, SCHEDULE_COLUMNS))
    yield (
        f'Columns of `{SCHEDULE_FILE}` of `plan_experiment` and `force_on_path`, set-points gauge and valid from their '
        f'time on: {columns}.'
    )
    yield f'Columns of `{CSV_FILE}` and `{PARQUET_FILE}`, which `identify_bag --each` writes:'
    yield table(
        ['column', 'kind', 'unit', 'meaning'],
        ([code(column.name), column.kind, column.unit, column.description] for column in COLUMNS),
    )


def main() -> None:
    """Write the documents and the help pages."""
    isolate()
    write_text(DOCUMENT, document())
    write_text(mapping_document.DOCUMENT, mapping_document.document())
    for name, page in pages().items():
        write_text(HELP / f'{name}.txt', page)
    print(f'{DOCUMENT}, {mapping_document.DOCUMENT} and {HELP}')


if __name__ == '__main__':
    main()
