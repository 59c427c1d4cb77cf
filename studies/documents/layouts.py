# SPDX-License-Identifier: Apache-2.0
"""
Write the layouts for PlotJuggler and Foxglove in `config/`: make layouts.

`compare` shows compare.mcap, `cell` a cell that runs: its device, simulator and monitor. Both programs show the same.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    CYLINDERS,
    FLOAT64,
    FLUID_PRESSURE,
    JOINT_STATE,
    MEASURED_FORCE,
    PISTON_JOINT,
    ROLES,
    WRENCH_STAMPED,
    pressure_topic,
    residual_topic,
    setpoint_topic,
)
from cfd_pneumatic.reporting import MEASURED, RESIDUAL, SIMULATED

FOLDER = Path(__file__).resolve().parents[2] / 'config'
CELL = '/cfd'
DEVICE, SIM, MONITOR = (f'{CELL}/{role}' for role in ('device', 'sim', 'monitor'))
BLUE, RED, GREEN = '#1f77b4', '#d62728', '#2ca02c'

JUGGLED = {
    FLUID_PRESSURE: 'fluid_pressure',
    FLOAT64: 'data',
    JOINT_STATE: f'{PISTON_JOINT}/position',
    WRENCH_STAMPED: 'wrench/force/x',
}
"""How PlotJuggler names a message's number, below its topic: joints by their own names."""

FOXED = {
    FLUID_PRESSURE: 'fluid_pressure',
    FLOAT64: 'data',
    JOINT_STATE: 'position[0]',
    WRENCH_STAMPED: 'wrench.force.x',
}
"""Foxglove's path of it in the message."""


class Curve(NamedTuple):
    """A number that is drawn over time."""

    topic: str
    msgtype: str
    label: str
    colour: str


Panels = dict[str, list[Curve]]
"""Curves that share their axes, by a title; panels stand below each other in a tab, with a title as well."""


class Layout(NamedTuple):
    """Where a layout finds its curves: the namespace of the device, and topics with gaps, with label and colour."""

    device: str
    simulated: Sequence[tuple[str, str, str]]
    residuals: Sequence[tuple[str, str, str]]


FOUND = (('without effects', RED), ('with those found', GREEN))
LAYOUTS = {
    'compare': Layout(
        MEASURED,
        [(f'{space}/{{topic}}', *words) for space, words in zip(SIMULATED, FOUND)],
        [(f'{space}/{{topic}}', *words) for space, words in zip(RESIDUAL, FOUND)],
    ),
    'cell': Layout(
        DEVICE,
        [(f'{SIM}/{{topic}}', 'simulator', RED)],
        [(f'{MONITOR}/{residual_topic("{name}")}', 'by the monitor', GREEN)],
    ),
}

COLOURS = (BLUE, RED, GREEN)

DISPLACEMENTS = [role for role in ROLES.values() if role.quantity == 'length']

QUANTITIES = {
    **{name: ('Pa', FLUID_PRESSURE, pressure_topic(name), pressure_topic(name)) for name in CYLINDERS},
    CONTACT_FORCE: ('N', WRENCH_STAMPED, MEASURED_FORCE, CONTACT_FORCE),
}
"""Unit and type of what is measured and simulated, and its topics below the namespaces of both."""


def views(layout: Layout) -> dict[str, Panels]:
    """Return each quantity with what is left of it, and below them what moves it."""
    found = {}
    for name, (unit, msgtype, measured, simulated) in QUANTITIES.items():
        by_model, residuals = (
            [Curve(topic.format(name=name, topic=simulated), msgtype, *words) for topic, *words in some]
            for some in (layout.simulated, layout.residuals)
        )
        found[name] = {
            f'measured and simulated [{unit}]': [
                Curve(f'{layout.device}/{measured}', msgtype, 'measured', BLUE),
                *by_model,
            ],
            f'measured less simulated [{unit}]': residuals,
            'displacement [m]': [
                Curve(f'{layout.device}/{role.topic}', role.msgtype, role.name, colour)
                for role, colour in zip(DISPLACEMENTS, COLOURS)
            ],
        }
        if name in CYLINDERS:
            setpoint = Curve(f'{layout.device}/{setpoint_topic(name)}', FLOAT64, 'set-point', BLUE)
            found[name]['set-point, gauge [Pa]'] = [setpoint]
    return found


def heights(panels: Panels) -> list[float]:
    """Return the share of the height that each panel has: what was measured half as much again."""
    total = len(panels) + 0.5
    return [1.5 / total, *[1.0 / total] * (len(panels) - 1)]


# PlotJuggler


def juggled(tabs: Mapping[str, Panels]) -> str:
    """Return a layout of PlotJuggler."""
    root = Element('root')
    widget = SubElement(root, 'tabbed_widget', {'name': 'Main Window', 'parent': 'main_window'})
    for name, panels in tabs.items():
        container = SubElement(SubElement(widget, 'Tab', containers='1', tab_name=name), 'Container')
        sizes = ';'.join(f'{share:.4f}' for share in heights(panels))
        splitter = SubElement(container, 'DockSplitter', orientation='-', count=str(len(panels)), sizes=sizes)
        for title, curves in panels.items():
            area = SubElement(splitter, 'DockArea', name=title)
            style = 'StepsInv' if curves[0].msgtype == FLOAT64 else 'Lines'
            plot = SubElement(area, 'plot', mode='TimeSeries', style=style, flip_x='false', flip_y='false')
            SubElement(plot, 'limitY')
            for curve in curves:
                SubElement(plot, 'curve', name=f'{curve.topic}/{JUGGLED[curve.msgtype]}', color=curve.colour)
    SubElement(widget, 'currentTabIndex', index='0')
    SubElement(root, 'use_relative_time_offset', enabled='1')
    indent(root)
    return tostring(root, encoding='unicode') + '\n'


# Foxglove


def foxed(tabs: Mapping[str, Panels]) -> str:
    """Return a layout of Foxglove."""
    plots: dict[str, Any] = {}
    stacks = []
    for name, panels in tabs.items():
        own = {f'Plot!{name}_{number}': _plot(*panel) for number, panel in enumerate(panels.items())}
        plots |= own
        stacks.append({'title': name, 'layout': _stacked(list(own), heights(panels))})
    plots['Tab!views'] = {'activeTabIdx': 0, 'tabs': stacks}
    layout = {'configById': plots, 'globalVariables': {}, 'userNodes': {}, 'playbackConfig': {'speed': 1}}
    return json.dumps(layout | {'layout': 'Tab!views'}, indent=2) + '\n'


def _plot(title: str, curves: Sequence[Curve]) -> dict[str, Any]:
    paths = []
    for curve in reversed(curves):  # here the first is on top, in PlotJuggler the last
        held = curve.msgtype == FLOAT64  # a set-point is held and then jumps: dots, for there are no steps
        path: dict[str, Any] = {
            'value': f'{curve.topic}.{FOXED[curve.msgtype]}',
            'label': curve.label,
            'color': curve.colour,
        }
        path |= {'enabled': True, 'timestampMethod': 'receiveTime' if held else 'headerStamp'}
        paths.append(path | {'showLine': not held, 'lineSize': 4 if held else 1})
    titles = {'foxglovePanelTitle': title, 'lichtblickPanelTitle': title}
    return titles | {'paths': paths, 'legendDisplay': 'left', 'sidebarDimension': 190}


def _stacked(names: Sequence[str], shares: Sequence[float]) -> Any:
    """Return panels below each other: Foxglove halves again and again."""
    first, *rest = names
    if not rest:
        return first
    share = 100.0 * shares[0] / sum(shares)
    below = _stacked(rest, shares[1:])
    return {'direction': 'column', 'first': first, 'second': below, 'splitPercentage': round(share, 2)}


def layouts() -> dict[Path, str]:
    """Return the text of each file."""
    written = {}
    for name, layout in LAYOUTS.items():
        written[FOLDER / f'{name}.plotjuggler.xml'] = juggled(views(layout))
        written[FOLDER / f'{name}.foxglove.json'] = foxed(views(layout))
    return written


if __name__ == '__main__':
    for path, text in layouts().items():
        path.write_text(text, encoding='utf-8')
        print(path)
