# SPDX-License-Identifier: Apache-2.0
"""`report.html` of a preview: the answers, and the force, its band and the set-points along the path."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cfd_pneumatic import __version__
from cfd_pneumatic.arrays import Array
from cfd_pneumatic.charts import Chart, Curve, Panel, plot_scripts
from cfd_pneumatic.path.prediction import Prediction
from cfd_pneumatic.path.preview import Held, Preview
from cfd_pneumatic.path.simulation import acting_at
from cfd_pneumatic.path.texts import answers
from cfd_pneumatic.reporting import rendered

TEMPLATES = Path(__file__).parent / 'templates'
TEMPLATE = 'preview.html.jinja'

CONSTANT, HELD, GREY = 'var(--before)', 'var(--after)', 'var(--muted)'
"""Colours of the constant and of the held set-points, and of the wanted force."""


def preview_page(preview: Preview) -> str:
    """Return the page of a preview."""
    return rendered(
        TEMPLATE,
        TEMPLATES,
        scripts=plot_scripts(),
        version=__version__,
        force=preview.task.force,
        answers=answers(preview),
        notes=preview.notes,
        chart=preview_chart(preview),
        has_tolerance=preview.task.tolerance is not None,
        is_held=preview.held is not None,
    )


def preview_chart(preview: Preview) -> Chart:
    """Return displacement, force and set-points over the position along the path, or over time."""
    constant, held = preview.constant, preview.held
    path = constant.path
    on_path = path.is_on_path
    times = path.grid[on_path]
    along = path.along_at(times)
    x, axis = (times, 'time [s]') if along is None else (1e3 * along, 'position along the path [mm]')
    levels = [(preview.task.force, GREY)]
    if preview.task.tolerance is not None:
        levels += [(preview.task.force + sign * preview.task.tolerance, GREY) for sign in (-1.0, 1.0)]
    forces = [*_force_curves(x, constant, CONSTANT, 'constant set-points')]
    if held is not None:
        forces += _force_curves(x, held.prediction, HELD, 'held')
    motion = Curve(x, 1e3 * path.displacement_at(times), 'currentColor', name='displacement')
    panels = [Panel('displacement [mm]', 130, [motion]), Panel(_force_title(preview), 260, forces, levels=levels)]
    if held is not None:
        setpoints = [
            Curve(x, 1e-3 * acting_at(level, times), colour, name=name.replace('_', ' '))
            for (name, level), colour in zip(held.prediction.setpoints.items(), (HELD, CONSTANT))
        ]
        panels.append(Panel(f'held set-points, gauge, {_setpoint_names(held)} [kPa]', 150, setpoints))
    label = 'Displacement, predicted contact force with its 95 % band, and set-points along the path.'
    return Chart(panels, (float(x[0]), float(x[-1])), axis, label, label)


def _setpoint_names(held: Held) -> str:
    return ', '.join(f'{name} {colour}' for name, colour in zip(held.prediction.setpoints, ('blue', 'orange')))


def _force_title(preview: Preview) -> str:
    names = 'constant set-points' if preview.held is None else 'constant set-points orange, held set-points blue'
    return f'contact force with 95 % band, {names} [N]'


def _force_curves(x: Array, prediction: Prediction, colour: str, name: str) -> Iterator[Curve]:
    on_path = prediction.path.is_on_path
    force, half = prediction.force[on_path], prediction.half_band[on_path]
    yield Curve(x, force - half, colour, 0.5, name=f'{name}, lower end of the band')
    yield Curve(x, force + half, colour, 0.5, name=f'{name}, upper end of the band')
    yield Curve(x, force, colour, 1.6, name=name)
