"""The picture of who talks to whom: make graph-figure writes docs/graph.svg."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl

mpl.use('svg')

import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    DIAGNOSTICS,
    EITHER,
    MEASURED_FORCE,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    residual_topic,
    setpoint_topic,
)
from cfd_pneumatic.reporting.names import COMPARE_FILE, PAGE_FILE, PARAMETER_FILE

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'graph.svg'

INK, PAPER = '#1f2933', '#ffffff'
OURS, YOURS, FILES = '#dbeafe', '#fde8cd', '#e7ecef'


class Box(NamedTuple):
    """A node, a program or files; its middle and size in the picture's units."""

    x: float
    y: float
    width: float
    height: float
    colour: str
    title: str
    lines: tuple[str, ...] = ()


class Arrow(NamedTuple):
    """What goes from a place to another, and where that is written."""

    begin: tuple[float, float]
    end: tuple[float, float]
    at: tuple[float, float]
    lines: tuple[str, ...] = ()
    align: str = 'center'


PRESSURE, SETPOINT, RESIDUAL = pressure_topic(EITHER), setpoint_topic(EITHER), residual_topic(EITHER)

BOXES = (
    Box(1.6, 5.2, 2.6, 1.3, YOURS, 'your device', ('its drivers, or rig_node', 'namespace /cfd/device')),
    Box(6.6, 6.3, 2.4, 1.1, OURS, 'sim_node', ('namespace /cfd/sim',)),
    Box(6.6, 4.1, 2.4, 1.1, OURS, 'monitor_node', ('namespace /cfd/monitor',)),
    Box(11.4, 6.3, 2.7, 1.1, YOURS, 'your deburring stack'),
    Box(11.4, 4.1, 2.7, 1.1, YOURS, 'your cell', ('operator, supervisor',)),
    Box(1.6, 1.5, 2.6, 1.1, FILES, 'bag or table', ('mcap, sqlite3, ROS 1, CSV',)),
    Box(6.6, 1.5, 2.4, 1.1, OURS, 'identify_bag', ('or identifier_node',)),
    Box(11.4, 1.5, 2.7, 1.1, FILES, PAGE_FILE, (COMPARE_FILE, 'report.json')),
)

ARROWS = (
    Arrow((2.9, 5.6), (5.4, 6.3), (4.05, 6.45), (PISTON_STATE, SETPOINT)),
    Arrow((7.8, 6.3), (10.05, 6.3), (9.0, 6.75), (PRESSURE, CONTACT_FORCE)),
    Arrow((2.9, 4.8), (5.4, 4.1), (4.05, 4.0), ('the same, and', PRESSURE, MEASURED_FORCE)),
    Arrow((7.8, 4.1), (10.05, 4.1), (9.0, 4.62), (DIAGNOSTICS, RESIDUAL, f'{PREDICTED}...')),
    Arrow((1.6, 4.55), (1.6, 2.05), (1.75, 3.2), ('ros2 bag record,', 'or recorder_node'), 'left'),
    Arrow((2.9, 1.5), (5.4, 1.5), (4.15, 1.75)),
    Arrow((7.8, 1.5), (10.05, 1.5), (9.0, 1.75)),
    Arrow((6.6, 2.05), (6.6, 3.55), (6.75, 2.8), (PARAMETER_FILE, 'for both nodes'), 'left'),
)


def draw(axes: plt.Axes) -> None:
    for box in BOXES:
        corner = (box.x - box.width / 2, box.y - box.height / 2)
        shape = FancyBboxPatch(
            corner,
            box.width,
            box.height,
            boxstyle='round,pad=0,rounding_size=0.12',
            facecolor=box.colour,
            edgecolor=INK,
        )
        axes.add_patch(shape)
        top = box.y + 0.14 * len(box.lines)
        axes.text(box.x, top, box.title, ha='center', va='center', weight='bold', size=11, color=INK)
        for rank, line in enumerate(box.lines, 1):
            axes.text(box.x, top - 0.29 * rank, line, ha='center', va='center', size=9, color=INK)
    for arrow in ARROWS:
        axes.add_patch(
            FancyArrowPatch(
                arrow.begin,
                arrow.end,
                arrowstyle='-|>',
                mutation_scale=14,
                color=INK,
                linewidth=1.2,
                shrinkA=0,
                shrinkB=0,
            )
        )
        words = '\n'.join(arrow.lines)
        axes.text(*arrow.at, words, ha=arrow.align, va='center', size=8.5, family='monospace', color=INK)


def main() -> None:
    mpl.rcParams['svg.hashsalt'] = 'graph'
    figure, axes = plt.subplots(figsize=(12.8, 7.0), facecolor=PAPER)
    axes.set(xlim=(0, 12.9), ylim=(0.7, 7.1), aspect='equal')
    axes.axis('off')
    draw(axes)
    figure.savefig(PICTURE, bbox_inches='tight', pad_inches=0.1, metadata={'Date': None})
    print(f'wrote {PICTURE}')


if __name__ == '__main__':
    main()
