"""An identification with its loop closed, for tests of what is made of it: droop in cylinder A, nothing in B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import MappingProxyType, SimpleNamespace

import numpy as np

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS
from cfd_pneumatic.identification import Estimate, Geometry, Identification, Options, PartError, identify
from cfd_pneumatic.identification.data.experiment import observed_motion
from cfd_pneumatic.identification.data.force_experiment import ForceExperiment, make_force_experiment
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.residual.tests import Test as ResidualTest
from cfd_pneumatic.identification.search.stepwise import Trial
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.rig.panel import draw

EPOCH = 1_700_000_000_000_000_000
AREA = 1.2e-3


def recording(name: str = 'cell_7_monday', seed: int = 0) -> Recording:
    """Return what the sensors of a device with droop in cylinder A gave."""
    got = draw('droop', 'out_and_back', seed).recording
    times = got.times - got.times[0]
    begins = np.concatenate([times[:1], times[:-1]])
    signals = {}
    for index, cylinder in enumerate(CYLINDERS):
        changes = np.diff(got.setpoints[:, index], prepend=np.nan) != 0.0
        signals[cylinder] = CylinderSignals(
            Signal(times, got.pressures[:, index]),
            Signal(begins[changes], got.setpoints[changes, index]),
        )
    return Recording(name, EPOCH, Signal(times, got.displacement), signals, Signal(times, got.force), ())


@cache
def closed() -> Identification:
    """Return the identification of one recording, pressures only."""
    return _without_force(identify([recording()], Options(close_loop=True)))


@cache
def open_loop() -> Identification:
    """Return the identification of the same recording where the loop was not closed."""
    return identify([recording()])


@cache
def closed_on_two() -> Identification:
    """Return the joint identification of two recordings."""
    recordings = [recording(), recording('cell_7_tuesday', 1)]
    return _without_force(identify(recordings, Options(close_loop=True)))


def _without_force(identification: Identification) -> Identification:
    object.__setattr__(identification, 'force', None)
    object.__setattr__(identification, 'geometry', Geometry())
    return identification


def judged(
    identification: Identification,
    verdict: str,
    why: str,
    alternatives: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Identification:
    """Return an identification with another verdict on cylinder A."""
    result = identification.cylinders['cylinder_a']
    closure = replace(result.closure, verdict=verdict, why=why, alternatives=alternatives)
    changed = replace(result, closure=closure)
    return _like(identification, cylinders={**identification.cylinders, 'cylinder_a': changed})


def _like(identification: Identification, **changes: object) -> Identification:
    force = getattr(identification, 'force', None)
    changed = replace(identification, **changes)
    object.__setattr__(changed, 'force', force)
    return changed


def with_force(identification: Identification) -> Identification:
    """Return an identification whose loop was closed on the force, too: seal friction, with made-up numbers."""
    experiments = tuple(_force_experiments(identification))
    before = tuple(AREA * one.difference for one in experiments)
    after = tuple(0.5 * (one.force + simulated) for one, simulated in zip(experiments, before))
    errors = [
        float(np.sqrt(np.mean(np.concatenate([one.force - force for one, force in zip(experiments, simulated)]) ** 2)))
        for simulated in (before, after)
    ]
    estimates = (
        Estimate('area', 'm^2', AREA, 1e-6, (1.198e-3, 1.202e-3), None),
        Estimate('seal_friction.coulomb', 'N', 2.5, 0.1, (2.3, 2.7), None),
        Estimate('seal_friction.viscous', 'N s/m', 40.0, 2.0, (36.0, 44.0), None),
        Estimate('seal_friction.presliding', 'm', 5e-05, 1e-6, (4.8e-05, 5.2e-05), None),
    )
    tests = [ResidualTest('noise_floor', value, 1.1, 'root mean square over that of the noise') for value in (3.0, 1.0)]
    closure = SimpleNamespace(
        verdict='effect_added',
        why='the force lacks seal_friction; with it the error falls to 50 %, and what is left is noise',
        effects=('seal_friction',),
        estimates=estimates,
        alternatives={},
        tried=(Trial('seal_friction', 1234.5, 0.75, errors[1], True, 'lowers the criterion most'),),
        ratio=0.5,
        ratio_interval=(0.45, 0.55),
        tests_before=(tests[0],),
        tests_after=(tests[1],),
        not_visible=('moving_mass',),
        next_experiment='quick strokes',
        before={part: PartError(errors[0], 10.0) for part in PARTS},
        after={part: PartError(errors[1], 5.0) for part in PARTS},
        noise_floor=0.9 * errors[1],
        fit=SimpleNamespace(area=AREA, factor=1.0, effects={'seal_friction': (2.5, 0.0, 40.0, 5e-5)}),
        experiments=experiments,
        simulated_before=before,
        simulated=after,
    )
    changed = replace(identification, geometry=Geometry(AREA, 1.0))
    object.__setattr__(changed, 'force', closure)
    return changed


def _force_experiments(identification: Identification) -> list[ForceExperiment]:
    return [
        make_force_experiment(one, observed_motion(one)[0], split, AMBIENT_PRESSURE)
        for one, split in zip(identification.recordings, identification.splits)
    ]
