# SPDX-License-Identifier: Apache-2.0
"""Plot of a preview with Matplotlib."""

from __future__ import annotations

from matplotlib import pyplot
from matplotlib.axes import Axes

from cfd_pneumatic.path.prediction import Prediction
from cfd_pneumatic.path.preview import Preview
from cfd_pneumatic.path.simulation import acting_at

_CONSTANT, _HELD = 'tab:red', 'tab:blue'


def plot_preview(preview: Preview) -> list[Axes]:
    """Plot displacement, force with its band, and held set-points along the path, each on an axes."""
    path = preview.constant.path
    times = path.grid[path.is_on_path]
    along = path.along_at(times)
    x = times if along is None else 1e3 * along
    rows = 2 if preview.held is None else 3
    _, grid = pyplot.subplots(rows, 1, sharex=True, squeeze=False, layout='constrained')
    axes = list(grid[:, 0])
    axes[0].plot(x, 1e3 * path.displacement_at(times), color='black')
    axes[0].set_ylabel('displacement [mm]')

    def plot_force(prediction: Prediction, colour: str, name: str) -> None:
        force, half = prediction.force[path.is_on_path], prediction.half_band[path.is_on_path]
        axes[1].fill_between(x, force - half, force + half, color=colour, alpha=0.2)
        axes[1].plot(x, force, color=colour, label=name)

    plot_force(preview.constant, _CONSTANT, 'constant set-points')
    tolerance = preview.task.tolerance
    for distance in (0.0,) if tolerance is None else (-tolerance, 0.0, tolerance):
        axes[1].axhline(preview.task.force + distance, color='grey', linestyle='--', linewidth=1.0)
    axes[1].set_ylabel('contact force [N]')
    if preview.held is not None:
        plot_force(preview.held.prediction, _HELD, 'held')
        axes[1].legend()
        for name, level in preview.held.prediction.setpoints.items():
            axes[2].step(x, 1e-3 * acting_at(level, times), where='post', label=name)
        axes[2].set_ylabel('set-point, gauge [kPa]')
        axes[2].legend()
    axes[-1].set_xlabel('time [s]' if along is None else 'position along the path [mm]')
    return axes
