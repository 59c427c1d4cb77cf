# SPDX-License-Identifier: Apache-2.0
"""
Write bags of any length: a device at 1 kHz with two cylinders, each with pressure and applied set-point.

The simulated motion repeats after 20 s. The noise of the sensors does not repeat.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from cfd_pneumatic import convention
from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import (
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_JOINT,
    PISTON_STATE,
    pressure_topic,
    setpoint_applied_topic,
)
from cfd_pneumatic.messages import NANOSECONDS, Form, standard_types
from cfd_pneumatic.model import DIRECTIONS, Cylinder, OperatingPoints
from cfd_pneumatic.recording import STORAGES, BagWriter, StorageName

AMBIENT = 101_325.0
GAINS = (4.33e6, 104.0, 19.4, 0.0105)
EPOCH = 1_700_000_000 * NANOSECONDS
STEP = 1_000_000  # ns
PERIOD = 20_000  # samples after which the motion repeats
TRANSPORT = 200_000  # ns from a sample to its reception; each further topic is received a hundredth later
PART = 1_500  # samples that are written together: a chunk of an mcap of the size of rosbag2

_TOPICS = {
    PISTON_STATE: convention.JOINT_STATE,
    **{
        topic(cylinder): convention.FLUID_PRESSURE
        for cylinder in CYLINDERS
        for topic in (pressure_topic, setpoint_applied_topic)
    },
    MEASURED_FORCE: convention.WRENCH_STAMPED,
}


def topics(force: bool = False) -> list[str]:
    """Return the topics of a bag."""
    return [f'/cfd/device/{topic}' for topic in _TOPICS if force or topic != MEASURED_FORCE]


@cache
def _period() -> Array:
    """Return one period of the true signals in the order of `_TOPICS`, shape (6, PERIOD)."""
    times = np.arange(float(PERIOD)) * (STEP / NANOSECONDS)
    strokes = np.concatenate([[0.0], np.random.default_rng(1).uniform(0.0, 3e-3, 18), [0.0]])
    phase = np.clip((times % 1.0 - 0.3) / 0.05, 0.0, 1.0)
    index = times.astype(int)
    before, after = strokes[np.maximum(index - 1, 0)], strokes[index]
    displacement = before + (after - before) * 0.5 * (1.0 - np.cos(np.pi * phase))
    setpoint = AMBIENT + np.where((times > 5.0) & (times < 15.0), 60e3, 40e3)
    cylinder = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT)
    signals = [displacement]
    for name in CYLINDERS:
        signals += [cylinder.simulate(times, DIRECTIONS[name] * displacement, setpoint), setpoint]
    return np.array([*signals, 100.0 + 1e-3 * (signals[1] - signals[3])])


_NOISE = np.array([1e-6, 50.0, 0.0, 50.0, 0.0, 0.5])[:, None]


def write_long_bag(
    path: Path,
    samples: int,
    storage: StorageName = 'mcap',
    compressed: bool = False,
    force: bool = False,
    signals: Array | None = None,
) -> Path:
    """Write a bag with samples of each topic, repeating `signals` (topics, n); return the path of its file."""
    names = topics(force)
    forms = [Form(msgtype, joint=PISTON_JOINT) for _, msgtype in zip(names, _TOPICS.values())]
    period = _period() if signals is None else signals
    noise = np.random.default_rng(2)
    with BagWriter(path, storage=storage) as bag:
        for topic, form in zip(names, forms):
            bag.add_topic(topic, form.msgtype)
        for begin in range(0, samples, PART):
            index = np.arange(begin, min(begin + PART, samples))
            values = period[: len(names), index % period.shape[1]]
            values = values + _NOISE[: len(names)] * noise.normal(size=values.shape)
            for rank, (topic, form) in enumerate(zip(names, forms)):
                block = form.block(EPOCH + index * STEP, values[rank])
                bag.write(topic, replace(block, times=block.times + TRANSPORT + rank * TRANSPORT // 100))
            bag.flush()
    if compressed:
        path = _compressed(path)
    (file,) = path.glob(f'*{STORAGES[storage].suffix}')
    return file


def _compressed(path: Path) -> Path:
    """Write a copy of a bag with compressed chunks; return its path."""
    copy = path.with_name(f'{path.name}_compressed')
    writer = Writer(copy, version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with Reader(path) as reader, writer:
        copied = {
            connection.id: writer.add_connection(connection.topic, connection.msgtype, typestore=standard_types())
            for connection in reader.connections
        }
        for connection, time, payload in reader.messages():
            writer.write(copied[connection.id], time, payload)
    return copy
