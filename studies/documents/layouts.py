# SPDX-License-Identifier: Apache-2.0
"""
Write the layouts for PlotJuggler and Foxglove in `config/`: make layouts.

`compare` shows compare.mcap. `cell` shows a running cell: its device, simulator and monitor. The layouts of both
programs have the same curves.
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

PLOTJUGGLER_PATHS = {
    FLUID_PRESSURE: 'fluid_pressure',
    FLOAT64: 'data',
    JOINT_STATE: f'{PISTON_JOINT}/position',
    WRENCH_STAMPED: 'wrench/force/x',
}
"""PlotJuggler's path of the number in a message, below the topic; joints have their names."""

FOXGLOVE_PATHS = {
    FLUID_PRESSURE: 'fluid_pressure',
    FLOAT64: 'data',
    JOINT_STATE: 'position[0]',
    WRENCH_STAMPED: 'wrench.force.x',
}
"""Foxglove's path of the number in a message."""


class Curve(NamedTuple):
    """A number of a message that is plotted over time."""

    topic: str
    msgtype: str
    label: str
    colour: str


Panels = dict[str, list[Curve]]
"""Curves on common axes, by the panel's title; the panels of a tab are below each other."""


class Layout(NamedTuple):
    """The device's namespace, and templates of topics with label and colour."""

    device: str
    simulated: Sequence[tuple[str, str, str]]
    residuals: Sequence[tuple[str, str, str]]


MODELS = (('without effects', RED), ('with found effects', GREEN))
LAYOUTS = {
    'compare': Layout(
        MEASURED,
        [(f'{space}/{{topic}}', *style) for space, style in zip(SIMULATED, MODELS)],
        [(f'{space}/{{topic}}', *style) for space, style in zip(RESIDUAL, MODELS)],
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
"""Unit, message type, measured topic and simulated topic of each quantity; topics without namespace."""


def views(layout: Layout) -> dict[str, Panels]:
    """Return the panels of each quantity: measured and simulated, residual, displacement, set-point."""
    panels_by_quantity = {}
    for name, (unit, msgtype, measured, simulated) in QUANTITIES.items():
        simulated_curves, residuals = (
            [Curve(topic.format(name=name, topic=simulated), msgtype, *style) for topic, *style in templates]
            for templates in (layout.simulated, layout.residuals)
        )
        panels_by_quantity[name] = {
            f'measured and simulated [{unit}]': [
                Curve(f'{layout.device}/{measured}', msgtype, 'measured', BLUE),
                *simulated_curves,
            ],
            f'measured less simulated [{unit}]': residuals,
            'displacement [m]': [
                Curve(f'{layout.device}/{role.topic}', role.msgtype, role.name, colour)
                for role, colour in zip(DISPLACEMENTS, COLOURS)
            ],
        }
        if name in CYLINDERS:
            setpoint = Curve(f'{layout.device}/{setpoint_topic(name)}', FLOAT64, 'set-point', BLUE)
            panels_by_quantity[name]['set-point, gauge [Pa]'] = [setpoint]
    return panels_by_quantity


def heights(panels: Panels) -> list[float]:
    """Return the share of the height of each panel; the first panel is 1.5 times as high as the others."""
    total = len(panels) + 0.5
    return [1.5 / total, *[1.0 / total] * (len(panels) - 1)]


# PlotJuggler


def plotjuggler_layout(tabs: Mapping[str, Panels]) -> str:
    """Return the tabs as a layout of PlotJuggler."""
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
                SubElement(plot, 'curve', name=f'{curve.topic}/{PLOTJUGGLER_PATHS[curve.msgtype]}', color=curve.colour)
    SubElement(widget, 'currentTabIndex', index='0')
    SubElement(root, 'use_relative_time_offset', enabled='1')
    indent(root)
    return tostring(root, encoding='unicode') + '\n'


# Foxglove


def foxglove_layout(tabs: Mapping[str, Panels]) -> str:
    """Return the tabs as a layout of Foxglove."""
    plots: dict[str, Any] = {}
    stacks = []
    for name, panels in tabs.items():
        tab_plots = {f'Plot!{name}_{number}': _plot(*panel) for number, panel in enumerate(panels.items())}
        plots |= tab_plots
        stacks.append({'title': name, 'layout': _stacked(list(tab_plots), heights(panels))})
    plots['Tab!views'] = {'activeTabIdx': 0, 'tabs': stacks}
    layout = {'configById': plots, 'globalVariables': {}, 'userNodes': {}, 'playbackConfig': {'speed': 1}}
    return json.dumps(layout | {'layout': 'Tab!views'}, indent=2) + '\n'


def _plot(title: str, curves: Sequence[Curve]) -> dict[str, Any]:
    paths = []
    for curve in reversed(curves):  # Foxglove draws the first curve on top, PlotJuggler the last
        is_setpoint = (
            curve.msgtype == FLOAT64
        )  # a set-point is constant between messages; Foxglove has no steps, so dots
        path: dict[str, Any] = {
            'value': f'{curve.topic}.{FOXGLOVE_PATHS[curve.msgtype]}',
            'label': curve.label,
            'color': curve.colour,
        }
        path |= {'enabled': True, 'timestampMethod': 'receiveTime' if is_setpoint else 'headerStamp'}
        paths.append(path | {'showLine': not is_setpoint, 'lineSize': 4 if is_setpoint else 1})
    titles = {'foxglovePanelTitle': title, 'lichtblickPanelTitle': title}
    return titles | {'paths': paths, 'legendDisplay': 'left', 'sidebarDimension': 190}


def _stacked(names: Sequence[str], shares: Sequence[float]) -> Any:
    """Return panels below each other; Foxglove splits a panel in two, recursively."""
    first, *following = names
    if not following:
        return first
    share = 100.0 * shares[0] / sum(shares)
    below = _stacked(following, shares[1:])
    return {'direction': 'column', 'first': first, 'second': below, 'splitPercentage': round(share, 2)}


def layouts() -> dict[Path, str]:
    """Return the text of each layout file."""
    written = {}
    for name, layout in LAYOUTS.items():
        written[FOLDER / f'{name}.plotjuggler.xml'] = plotjuggler_layout(views(layout))
        written[FOLDER / f'{name}.foxglove.json'] = foxglove_layout(views(layout))
    return written


if __name__ == '__main__':
    for path, text in layouts().items():
        path.write_text(text, encoding='utf-8')
        print(path)
