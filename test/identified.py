# SPDX-License-Identifier: Apache-2.0
"""An identification with its loop closed, for tests of what is made of it: droop in cylinder A, nothing in B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import MappingProxyType

import numpy as np

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.identification import ChannelResult, Estimate, Identification, Options, PartError, identify
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.conclusion import Conclusion
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.fit.fit import fit_model
from cfd_pneumatic.identification.preparation import prepare_recordings
from cfd_pneumatic.identification.residual.noise import Noise
from cfd_pneumatic.identification.residual.tests import Test as ResidualTest
from cfd_pneumatic.identification.result import Comparison
from cfd_pneumatic.identification.search.stepwise import Trial
from cfd_pneumatic.recording import Recording, recording_of
from studies.panel import draw

EPOCH = 1_700_000_000_000_000_000
AREA = 1.2e-3


def recording(name: str = 'cell_7_monday', seed: int = 0) -> Recording:
    """Return what the sensors of a device with droop in cylinder A gave."""
    return recording_of(draw('droop', 'out_and_back', seed).recording, name, EPOCH)


@cache
def _whole() -> Identification:
    return identify([recording()], Options(close_loop=True))


@cache
def closed() -> Identification:
    """Return the identification of one recording, pressures only."""
    return _without_force(_whole())


@cache
def open_loop() -> Identification:
    """Return the identification of the same recording where the loop was not closed."""
    return identify([recording()])


@cache
def closed_on_two() -> Identification:
    """Return the joint identification of two recordings, of which the second repeats the first."""
    recordings = [recording(), recording('cell_7_tuesday')]
    return _without_force(identify(recordings, Options(close_loop=True)))


def _without_force(identification: Identification) -> Identification:
    return replace(identification, channels=identification.cylinders)


def judged(
    identification: Identification,
    verdict: str,
    why: str,
    alternatives: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Identification:
    """Return an identification with another verdict on cylinder A."""
    result = identification.channels['cylinder_a']
    conclusion = replace(result.conclusion, verdict=verdict, why=why, alternatives=alternatives)
    changed = replace(result, conclusion=conclusion)
    return replace(identification, channels={**identification.channels, 'cylinder_a': changed})


def with_force(identification: Identification) -> Identification:
    """Return an identification whose loop was closed on the force, too: seal friction, with made-up numbers."""
    data = prepare_recordings(identification.recordings)
    channel = Force(AREA, 1.0, AMBIENT_PRESSURE)
    experiments = data.experiments(channel)
    plain = fit_model(channel, experiments)
    before = tuple(channel.simulated(experiments, replace(plain.model, parameters=np.array([AREA, 1.0]))))
    after = tuple(0.5 * (one.measured + simulated) for one, simulated in zip(experiments, before))
    errors = [
        float(np.sqrt(np.mean(np.concatenate([one.measured - own for one, own in zip(experiments, simulated)]) ** 2)))
        for simulated in (before, after)
    ]
    estimates = (
        Estimate('area', 'm^2', AREA, 1e-6, (1.198e-3, 1.202e-3), None),
        Estimate('seal_friction.coulomb', 'N', 2.5, 0.1, (2.3, 2.7), None),
        Estimate('seal_friction.viscous', 'N s/m', 40.0, 2.0, (36.0, 44.0), None),
        Estimate('seal_friction.presliding', 'm', 5e-05, 1e-6, (4.8e-05, 5.2e-05), None),
    )
    tests = [ResidualTest('noise_floor', value, 1.1, 'root mean square over that of the noise') for value in (3.0, 1.0)]
    noise = Noise(0.9 * errors[1], np.empty(0), 0.01, True, False)
    conclusion = Conclusion(
        verdict='effect_added',
        why='Missing effect: seal_friction. Adding it reduces the error to 50 %. The remaining error is sensor noise',
        core='linear',
        effects=('seal_friction',),
        alternatives={},
        tried=(Trial('seal_friction', 1234.5, 0.75, errors[1], True, 'lowers the criterion most'),),
        ratio=0.5,
        ratio_interval=(0.45, 0.55),
        tests_before=(tests[0],),
        tests_after=(tests[1],),
        noise=noise,
        not_visible=('moving_mass',),
        next_experiment='quick strokes',
    )
    model = replace(plain.model, parameters=np.array([AREA, 1.0]), effects={'seal_friction': (2.5, 0.0, 40.0, 5e-5)})
    result = ChannelResult(
        channel=channel,
        fit=replace(plain, estimates=()),
        schedule=(),
        comparisons=tuple(Comparison(channel, *one) for one in zip(data.holding(channel), experiments, before, after)),
        before={part: PartError(errors[0], 10.0) for part in PARTS},
        after={part: PartError(errors[1], 5.0) for part in PARTS},
        span=float(np.mean([one.span for one in experiments])),
        noise=noise,
        notes=(),
        found=replace(plain, model=model, estimates=estimates, simulated=after),
        conclusion=conclusion,
    )
    channels = {**identification.channels, 'force': result}
    return replace(identification, channels=channels)
