"""
Write the layouts for PlotJuggler and Foxglove in `config/`: make layouts.

`compare` shows compare.mcap, `cell` a cell that runs: its device, simulator and monitor. Both programs show the same.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_JOINT,
    PISTON_STATE,
    pressure_topic,
    residual_topic,
    setpoint_topic,
)
from cfd_pneumatic.recording.messages import FLOAT64, FLUID_PRESSURE, JOINT_STATE, WRENCH_STAMPED
from cfd_pneumatic.reporting.comparison import MEASURED, RESIDUAL, SIMULATED

FOLDER = Path(__file__).resolve().parents[1] / 'config'
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


class Panel(NamedTuple):
    """Curves that share their axes."""

    title: str
    curves: Sequence[Curve]


class View(NamedTuple):
    """Panels below each other: a tab."""

    title: str
    panels: Sequence[Panel]


class Quantity(NamedTuple):
    """What is measured and simulated, with its topics below the namespaces of both."""

    name: str
    unit: str
    msgtype: str
    measured: str
    simulated: str


QUANTITIES = (
    *(Quantity(name, 'Pa', FLUID_PRESSURE, pressure_topic(name), pressure_topic(name)) for name in CYLINDERS),
    Quantity(CONTACT_FORCE, 'N', WRENCH_STAMPED, MEASURED_FORCE, CONTACT_FORCE),
)


def compared() -> list[View]:
    """Return what compare.mcap holds."""
    words = (('without effects', RED), ('with those found', GREEN))
    return [
        view(
            one,
            MEASURED,
            [Curve(f'{space}/{one.simulated}', one.msgtype, *word) for space, word in zip(SIMULATED, words)],
            [Curve(f'{space}/{one.simulated}', one.msgtype, *word) for space, word in zip(RESIDUAL, words)],
        )
        for one in QUANTITIES
    ]


def live() -> list[View]:
    """Return what a cell publishes."""
    return [
        view(
            one,
            DEVICE,
            [Curve(f'{SIM}/{one.simulated}', one.msgtype, 'simulator', RED)],
            [Curve(f'{MONITOR}/{residual_topic(one.name)}', one.msgtype, 'by the monitor', GREEN)],
        )
        for one in QUANTITIES
    ]


def view(quantity: Quantity, device: str, simulated: Sequence[Curve], residuals: Sequence[Curve]) -> View:
    """Return a quantity with what is left of it, and below them what moves it; `device` is the measured namespace."""
    measured = Curve(f'{device}/{quantity.measured}', quantity.msgtype, 'measured', BLUE)
    panels = [
        Panel(f'measured and simulated [{quantity.unit}]', [measured, *simulated]),
        Panel(f'measured less simulated [{quantity.unit}]', residuals),
        Panel('displacement [m]', [Curve(f'{device}/{PISTON_STATE}', JOINT_STATE, 'piston', BLUE)]),
    ]
    if quantity.name in CYLINDERS:
        topic = f'{device}/{setpoint_topic(quantity.name)}'
        panels.append(Panel('set-point, gauge [Pa]', [Curve(topic, FLOAT64, 'set-point', BLUE)]))
    return View(quantity.name, panels)


LAYOUTS: dict[str, Callable[[], list[View]]] = {'compare': compared, 'cell': live}
"""What makes each layout, by its name."""


def heights(view: View) -> list[float]:
    """Return the share of the height that each panel of a view has: what was measured half as much again."""
    weights = [1.5 if number == 0 else 1.0 for number in range(len(view.panels))]
    return [weight / sum(weights) for weight in weights]


# PlotJuggler


def juggled(views: Sequence[View]) -> str:
    """Return a layout of PlotJuggler."""
    root = ElementTree.Element('root')
    tabs = _element(root, 'tabbed_widget', name='Main Window', parent='main_window')
    for view in views:
        container = _element(_element(tabs, 'Tab', containers='1', tab_name=view.title), 'Container')
        sizes = ';'.join(f'{share:.4f}' for share in heights(view))
        splitter = _element(container, 'DockSplitter', orientation='-', count=str(len(view.panels)), sizes=sizes)
        for panel in view.panels:
            area = _element(splitter, 'DockArea', name=panel.title)
            held = all(curve.msgtype == FLOAT64 for curve in panel.curves)
            style = 'StepsInv' if held else 'Lines'
            plot = _element(area, 'plot', mode='TimeSeries', style=style, flip_x='false', flip_y='false')
            _element(plot, 'limitY')
            for curve in panel.curves:
                _element(plot, 'curve', name=f'{curve.topic}/{JUGGLED[curve.msgtype]}', color=curve.colour)
    _element(tabs, 'currentTabIndex', index='0')
    _element(root, 'use_relative_time_offset', enabled='1')
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode') + '\n'


def _element(above: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(above, tag, attributes)


# Foxglove


def foxed(views: Sequence[View]) -> str:
    """Return a layout of Foxglove."""
    panels: dict[str, Any] = {}
    tabs = []
    for view in views:
        names = [f'Plot!{view.title}_{number}' for number in range(len(view.panels))]
        panels |= zip(names, map(_plot, view.panels))
        tabs.append({'title': view.title, 'layout': _stacked(names, heights(view))})
    panels['Tab!views'] = {'activeTabIdx': 0, 'tabs': tabs}
    layout = {'configById': panels, 'globalVariables': {}, 'userNodes': {}, 'playbackConfig': {'speed': 1}}
    return json.dumps(layout | {'layout': 'Tab!views'}, indent=2) + '\n'


def _plot(panel: Panel) -> dict[str, Any]:
    paths = [
        {
            'value': f'{curve.topic}.{FOXED[curve.msgtype]}',
            'label': curve.label,
            'color': curve.colour,
            'enabled': True,
            'timestampMethod': 'receiveTime' if curve.msgtype == FLOAT64 else 'headerStamp',
            'showLine': curve.msgtype != FLOAT64,  # a set-point is held and then jumps
            'lineSize': 4 if curve.msgtype == FLOAT64 else 1,
        }
        for curve in reversed(panel.curves)  # here the first is on top, in PlotJuggler the last
    ]
    return {
        'foxglovePanelTitle': panel.title,
        'lichtblickPanelTitle': panel.title,
        'paths': paths,
        'xAxisVal': 'timestamp',
        'isSynced': True,
        'showLegend': True,
        'legendDisplay': 'left',
        'showPlotValuesInLegend': False,
        'showXAxisLabels': True,
        'showYAxisLabels': True,
        'sidebarDimension': 190,
    }


def _stacked(names: Sequence[str], shares: Sequence[float]) -> Any:
    """Return panels below each other: Foxglove halves again and again."""
    first, *rest = names
    if not rest:
        return first
    share = shares[0] / sum(shares)
    below = _stacked(rest, shares[1:])
    return {'direction': 'column', 'first': first, 'second': below, 'splitPercentage': round(100.0 * share, 2)}


def layouts() -> dict[Path, str]:
    """Return the text of each file."""
    written = {}
    for name, views in LAYOUTS.items():
        written[FOLDER / f'{name}.plotjuggler.xml'] = juggled(views())
        written[FOLDER / f'{name}.foxglove.json'] = foxed(views())
    return written


if __name__ == '__main__':
    for path, text in layouts().items():
        path.write_text(text, encoding='utf-8')
        print(path)
