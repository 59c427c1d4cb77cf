# SPDX-License-Identifier: Apache-2.0
"""
Plot the force along the path of the tutorial on holding the force: make path-picture.

The commands of docs/tutorials/hold_the_force.md run in an empty folder. The picture compares the predictions with the
forces that the virtual rig recorded.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from cfd_pneumatic.recording import read_recording
from studies.documents.effects import STYLE
from studies.documents.tutorial import HOLD_THE_FORCE, blocks, programs, run
from studies.tools.provenance import ROOT

PICTURE = ROOT / 'docs' / 'force_on_path.svg'

_COLOURS = {'constant': 'tab:orange', 'held': 'tab:blue'}
_REST = 0.5  # of a schedule before the path [s]
_STEP = 6  # every sixth sample, which is enough for the width of the picture


def plot_forces(folder: Path) -> Figure:
    """Plot the surface, and the forces with constant and with held set-points, from the folder of the tutorial."""
    preview = json.loads((folder / 'held' / 'preview.json').read_text(encoding='utf-8'))
    along = 1e3 * np.array(preview['along_m'])[::_STEP]
    figure = Figure(figsize=(7.5, 3.6), layout='constrained')
    surface, forces = figure.subplots(2, 1, sharex=True, height_ratios=(1, 3))
    surface.plot(along, 1e3 * np.array(preview['displacement_m'])[::_STEP], '0.2')
    surface.set_ylabel('piston [mm]')
    target, tolerance = preview['force_n'], preview['tolerance_n']
    forces.axhspan(target - tolerance, target + tolerance, color='0.93', label='tolerance')
    for name, colour in _COLOURS.items():
        recorded = read_recording(folder / f'{name}_bag').force
        assert recorded is not None
        measured = np.interp(np.array(preview['time_s'])[::_STEP] + _REST, recorded.times, recorded.values)
        forces.plot(along, measured, color=colour, linewidth=0.4, alpha=0.7, label=f'{name}: recorded')
        predicted, half = (np.array(preview[name][key])[::_STEP] for key in ('force_n', 'half_band_n'))
        forces.fill_between(along, predicted - half, predicted + half, color=colour, alpha=0.3, linewidth=0)
        forces.plot(along, predicted, color=colour, linewidth=1.4, label=f'{name}: predicted')
    forces.set(xlabel='position along the path [mm]', ylabel='contact force [N]', xlim=(along[0], along[-1]))
    forces.legend(loc='lower center', bbox_to_anchor=(0.5, 0.98), ncol=5, frameon=False)
    return figure


def main() -> int:
    """Write the picture; return the exit code."""
    with tempfile.TemporaryDirectory() as name, matplotlib.rc_context(STYLE | {'svg.hashsalt': PICTURE.stem}):
        folder = Path(name)
        environment = programs(folder / 'bin')
        for block in blocks(HOLD_THE_FORCE):
            if block.language == 'sh':
                run(block.text, folder, environment)
        plot_forces(folder).savefig(PICTURE, format='svg', metadata={'Date': None})
    print(f'{PICTURE}: {PICTURE.stat().st_size // 1000} kB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
