# SPDX-License-Identifier: Apache-2.0
"""Plot of a recording with Matplotlib: measured values, simulated values and residuals."""

from __future__ import annotations

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from cfd_pneumatic.charts import thinned
from cfd_pneumatic.identification import PARTS, ChannelResult, Comparison, Identification, readable_name, title

_COLUMNS = 2_000  # pixels across the plot
_SIZE = (10.0, 3.4)  # width and height of a channel's plots [inch]


def overview(identification: Identification, recording: int) -> list[Axes]:
    """Plot every channel of a recording; return two axes for each channel, values and residuals."""
    recorded = [
        (result, comparison)
        for result in identification.channels.values()
        for comparison in result.comparisons
        if comparison.recording == recording
    ]
    figure = plt.figure(figsize=(_SIZE[0], _SIZE[1] * len(recorded)), layout='constrained')
    ratios = {'height_ratios': [2, 1] * len(recorded)}
    axes = list(figure.subplots(2 * len(recorded), 1, sharex=True, squeeze=False, gridspec_kw=ratios)[:, 0])
    for rank, (result, comparison) in enumerate(recorded):
        _draw(axes[2 * rank], axes[2 * rank + 1], result, comparison)
    axes[-1].set_xlabel('time [s]')
    return axes


def _draw(values: Axes, residuals: Axes, result: ChannelResult, comparison: Comparison) -> None:
    large, small = result.quantity.large, result.quantity.small
    series = {f'simulated, {result.quantity.model}': (0, 'tab:orange', comparison.before)}
    if result.added:
        series[f'simulated, with {" and ".join(map(readable_name, result.added))}'] = (1, 'tab:blue', comparison.after)
    times = comparison.times
    measured = thinned(times, comparison.experiment.measured / large.si, _COLUMNS)
    values.plot(*measured, color='0.3', linewidth=1.6, label='measured')
    for label, (which, colour, simulated) in series.items():
        values.plot(*thinned(times, simulated / large.si, _COLUMNS), color=colour, linewidth=0.9, label=label)
        residual = comparison.residual(which) / small.si
        residuals.plot(*thinned(times, residual, _COLUMNS), color=colour, linewidth=0.8)
    values.set_title(f'{title(result.name)}, {comparison.name}', loc='left', fontsize=10)
    values.set_ylabel(f'[{large.unit}]')
    residuals.set_ylabel(f'residual [{small.unit}]')
    values.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncol=3, fontsize=8, frameon=False, borderaxespad=0.2)
    test = comparison.experiment.part == PARTS.index('test')
    if test.any():
        for axis in (values, residuals):
            axis.axvspan(times[test][0], times[test][-1], color='0.93', zorder=0.0)
        residuals.annotate('test', (times[test][0], 1.0), (3, -3), ('data', 'axes fraction'), 'offset points', va='top')
