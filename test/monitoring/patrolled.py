# SPDX-License-Identifier: Apache-2.0
"""A rig that is as the paper's device, its identified model, and a watch that hears the one beside the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.model import DeviceModel
from cfd_pneumatic.monitoring import Finding, Settings, Watch, diagnose
from cfd_pneumatic.recording import Recording, recording_of
from cfd_pneumatic.rig import RigParameters, RigRecord, record, surface_following, with_changes
from studies.documents.monitor_figures import EPOCH, surfaces
from studies.panel.specimen import draw_specimen

RATE = 500
SETTINGS = Settings(learning=20.0, window=15.0)
LEARNED = 22.0  # by when everything has been learned [s]


class Sample(NamedTuple):
    """What the drivers of a device publish at one time."""

    stamp: int
    position: float
    setpoints: tuple[float, float]
    pressures: tuple[float, float]
    force: float


def samples(record: RigRecord) -> Iterator[Sample]:
    """Yield the samples of a record."""
    stamps = EPOCH + np.round(record.times * 1e9).astype(np.int64)
    columns = (stamps, record.displacement, record.setpoints, record.pressures, record.force)
    for stamp, position, setpoints, pressures, force in zip(*(column.tolist() for column in columns)):
        yield Sample(stamp, position, tuple(setpoints), tuple(pressures), force)


def hear(watch: Watch, sample: Sample, now: float) -> list[tuple[str, int, float]]:
    """Let the watch hear a sample; return the residuals."""
    watch.add_piston_sample(sample.stamp, sample.position, sample.setpoints, now)
    for name, pressure in zip(CYLINDERS, sample.pressures):
        watch.add_measurement(name, sample.stamp, pressure, now)
    watch.add_measurement(CONTACT_FORCE, sample.stamp, sample.force, now)
    return list(watch.new_residuals(now))


Spoil = Callable[[Sample], 'Sample | None']
"""What becomes of a sample on its way; None where it is lost."""


@cache
def rig() -> RigParameters:
    return draw_specimen(np.random.default_rng(7))[0].rig


@cache
def device() -> DeviceModel:
    got = record(surface_following(duration=20.0, seed=1), rig(), seed=1)
    return identified_device(identify([recording_of(got)])).model


def close_loop(recording: Recording) -> Finding:
    return diagnose(recording, Options(close_loop=True))


def nothing_found(recording: Recording) -> Finding:
    return Finding({})


@dataclass
class Patrol:
    """A watch on its way beside the rig."""

    diagnosis: Callable[[Recording], Finding] = nothing_found
    seed: int = 3
    kinds: set[str] = field(default_factory=set)
    faults: list[str] = field(default_factory=list)
    asked: list[Recording] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.watch = Watch(device(), SETTINGS, self._ask)
        self.performance = surfaces(rig(), self.seed)
        self.now = 0.0
        self.residuals: list[tuple[str, int, float]] = []

    def _ask(self, recording: Recording) -> Future[Finding]:
        self.asked.append(recording)
        answer: Future[Finding] = Future()
        answer.set_result(self.diagnosis(recording))
        return answer

    def go_on(self, seconds: float, spoil: Spoil = lambda sample: sample) -> Patrol:
        """Hear so many seconds, look after the watch each tenth of one."""
        for _ in range(round(seconds * 10)):
            for sample in samples(self.performance.advance(RATE // 10)):
                self.now = (sample.stamp - EPOCH) * 1e-9
                spoilt = spoil(sample)
                if spoilt is not None:
                    self.residuals += hear(self.watch, spoilt, self.now)
            found = self.watch.faults(self.now)
            self.kinds |= {fault.kind for fault in found}
            self.faults += [fault.message for fault in found]
            self.watch.update_alarms()
        return self

    def let(self, **effects: float) -> Patrol:
        """Let something go wrong with cylinder A."""
        self.performance.change(with_changes(rig(), {f'effects_a.{name}': value for name, value in effects.items()}))
        return self


@cache
def _learned() -> Patrol:
    patrol = Patrol().go_on(LEARNED)
    patrol.residuals.clear()
    return patrol


def learned() -> Patrol:
    """Return a patrol that has learned all, and closes no loop."""
    return deepcopy(_learned())
