# SPDX-License-Identifier: Apache-2.0
"""Files of a preview: page, JSON, bag and schedule."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS, SCHEDULE_COLUMNS, WRENCH_STAMPED
from cfd_pneumatic.files import ResultFiles, marked, staged_output
from cfd_pneumatic.messages import Form
from cfd_pneumatic.path.data import preview_data
from cfd_pneumatic.path.names import BAG_FILE, PAGE_FILE, PREVIEW_FILE, SCHEDULE_FILE
from cfd_pneumatic.path.page import preview_page
from cfd_pneumatic.path.prediction import Prediction
from cfd_pneumatic.path.preview import Preview
from cfd_pneumatic.path.simulation import acting_at
from cfd_pneumatic.recording import BagWriter, CylinderSignals, Recording, Signal, Stream, stamps_of, streams_of
from cfd_pneumatic.reporting import is_page

CONSTANT, HELD = '/constant', '/held'
"""Namespaces of the bag: at constant set-points, and at set-points that hold the force."""

LOW, HIGH = '/band_low', '/band_high'
"""Namespaces below, for the ends of the 95 % band of the force."""

_STRIDE = 5  # samples of a prediction per sample of the bag, which has 100 Hz

_is_preview = marked(r'\A\{\s*"schema": \d+,\s*"force_n": ')
_is_bag = marked(rf'(?s)\A\x89MCAP.{{,64}}cfd_pneumatic.*{CONSTANT}{LOW}/')
_is_table = marked(rf'\A{",".join(SCHEDULE_COLUMNS)}\n0\.0,')


def _is_schedule(path: Path) -> bool:
    """Return whether a table belongs to a preview: a table by the user is not next to a preview."""
    return _is_table(path) and _is_preview(path.with_name(PREVIEW_FILE))


FILES = ResultFiles({PAGE_FILE: is_page, BAG_FILE: _is_bag, SCHEDULE_FILE: _is_schedule, PREVIEW_FILE: _is_preview})
"""Marks by which the files of a preview are recognised."""


def write_preview(preview: Preview, folder: Path, *, overwrite: bool = False) -> list[Path]:
    """
    Write the files of a preview into a folder, which is created if necessary.

    Raises
    ------
    InputError
        If the folder cannot be written, or an existing file must not be replaced.

    """
    contents = {
        PAGE_FILE: preview_page(preview),
        PREVIEW_FILE: json.dumps(preview_data(preview), allow_nan=False) + '\n',
        SCHEDULE_FILE: schedule_text(preview.constant if preview.held is None else preview.held.prediction),
    }
    with FILES.made_for(folder, overwrite=overwrite) as made:
        for name, content in contents.items():
            (made / name).write_text(content, encoding='utf-8')
        _write_bag(preview, made / BAG_FILE)
    return [folder / name for name in (*contents, BAG_FILE)]


def schedule_text(prediction: Prediction) -> str:
    """Return the schedule for `record_rig`, `rig_node` and a robot: motion and gauge set-points, with the rests."""
    path = prediction.path
    levels = [
        acting_at(prediction.setpoints[name], path.grid) if name in prediction.setpoints else np.zeros(path.grid.size)
        for name in CYLINDERS
    ]
    columns = (path.grid - path.grid[0], path.displacement_at(path.grid), path.speed_at(path.grid), *levels)
    rows = (','.join(f'{value:.9g}' if value else '0.0' for value in row) for row in np.column_stack(columns).tolist())
    return '\n'.join([','.join(SCHEDULE_COLUMNS), *rows]) + '\n'


def _write_bag(preview: Preview, path: Path) -> None:
    """Write the bag as a single MCAP file."""
    streams = list(_streams(preview.constant, CONSTANT, preview))
    if preview.held is not None:
        streams += _streams(preview.held.prediction, HELD, preview)
    with staged_output(path) as staged_file:
        bag = staged_file.with_name('bag')
        with BagWriter(bag) as writer:
            writer.write_streams(streams)
        os.replace(next(bag.glob('*.mcap')), staged_file)


def _streams(prediction: Prediction, namespace: str, preview: Preview) -> Iterator[Stream]:
    """Yield displacement, set-points, pressures and force, and the ends of the band of the force."""
    path = prediction.path
    shown = slice(None, None, _STRIDE)
    times = (path.grid - path.grid[0])[shown]
    ambient = preview.identified.device.number('ambient_pressure')
    cylinders = {
        name: CylinderSignals(
            Signal(times, pressure[shown]), _absolute(prediction.setpoints[name], path.grid[0], ambient)
        )
        for name, pressure in prediction.response.pressures.items()
    }
    recording = Recording('path', 0, Signal(times, path.displacement_at(path.grid[shown])), cylinders, None, ())
    yield from streams_of(recording, namespace, ambient)
    half = prediction.half_band
    for place, values in (('', prediction.force), (LOW, prediction.force - half), (HIGH, prediction.force + half)):
        topic = f'{namespace}{place}/{CONTACT_FORCE}'
        yield Stream(topic, Form(WRENCH_STAMPED), stamps_of(recording, times), values[shown])


def _absolute(level: float | Signal, begin: float, ambient: float) -> Signal:
    """Return a set-point as absolute pressure over the time of the bag."""
    if isinstance(level, Signal):
        return Signal(level.times - begin, level.values + ambient)
    return Signal(np.zeros(1), np.array([level + ambient]))
