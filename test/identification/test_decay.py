# SPDX-License-Identifier: Apache-2.0
"""Leaks behind a shut valve: decays whose truth another integrator made, and measured ones."""

from __future__ import annotations

import numpy as np
import pytest
from measured import DECAYS, ROOT, needs_measured_data
from scipy.integrate import solve_ivp

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.decay import LAWS, decay_of
from cfd_pneumatic.recording import Signal, read_recording

START = 7e5  # gauge [Pa]
NOISE = 220.0  # [Pa]
TIMES = 0.1 * np.arange(1400)
DURATION = float(TIMES[-1])


def passes(law, pressure):
    """Return what a leak passes, by laminar flow or by ISO 6358 with the critical ratio of an ideal nozzle."""
    if law == 'gap':
        return pressure - AMBIENT_PRESSURE
    unchoked = np.clip((AMBIENT_PRESSURE / pressure - 0.528) / (1.0 - 0.528), 0.0, 1.0)
    return pressure * np.sqrt(1.0 - unchoked**2)


def decay(law, conductance, seed, *, times=TIMES, settling=0.0, time_constant=15.0):
    """Return a decay: a leak, and what settles beside it."""
    begin = [AMBIENT_PRESSURE + START]
    leaks = solve_ivp(
        lambda _, p: -conductance * passes(law, p), times[[0, -1]], begin, t_eval=times, rtol=1e-9, atol=1e-3
    )
    noise = np.random.default_rng(seed).normal(0.0, NOISE, times.size)
    return Signal(times, leaks.y[0] + settling * np.exp(-times / time_constant) + noise)


@pytest.mark.parametrize('settling', [0.0, 5e3])
@pytest.mark.parametrize('law', LAWS)
def test_the_law_and_its_conductance_are_told(law, settling):
    covered = []
    for seed in range(8):
        conductance = (0.4 + 0.15 * seed) / DURATION
        told = decay_of(decay(law, conductance, seed, settling=settling), AMBIENT_PRESSURE)
        assert [leak.characteristic for leak in told.leaks if not leak.excluded] == [law]
        assert told.has_leak
        assert told.best.error < 1.5 * NOISE
        assert told.best.settling == pytest.approx(settling, abs=0.1 * settling)
        covered.append(told.best.interval[0] <= conductance <= told.best.interval[1])
    assert sum(covered) >= 7


@pytest.mark.parametrize('law', LAWS)
def test_a_short_fall_tells_no_law_and_how_far_it_has_to_fall(law):
    conductance = 0.02 / DURATION
    short = decay_of(decay(law, conductance, 0), AMBIENT_PRESSURE)
    assert not any(leak.excluded for leak in short.leaks)
    gauge, time = short.distinguishable_below
    assert 0.0 < gauge < START
    longer = decay_of(decay(law, conductance, 1, times=np.linspace(0.0, time, 1500)), AMBIENT_PRESSURE)
    assert [leak.characteristic for leak in longer.leaks if not leak.excluded] == [law]


def test_what_only_settles_is_no_leak():
    told = decay_of(decay('gap', 0.0, 3, settling=8e3, time_constant=40.0), AMBIENT_PRESSURE)
    assert not told.has_leak
    assert told.best.interval[1] < 1e-4
    assert told.best.settling == pytest.approx(8e3, rel=0.2)


def test_a_pressure_that_holds_has_no_leak():
    held = decay_of(decay('gap', 0.0, 4), AMBIENT_PRESSURE)
    assert not held.has_leak
    assert held.best.interval[1] * START * DURATION < 3.0 * NOISE


@pytest.mark.parametrize(
    ('signal', 'message'),
    [
        (Signal(TIMES[:0], TIMES[:0]), '0 samples are too few'),
        (Signal(TIMES[:20], np.full(20, 3e5)), '20 samples are too few'),
        (Signal(TIMES, np.full(TIMES.size, 3e5)), 'never changes'),
        (Signal(TIMES, 1e5 + TIMES), 'kPa above ambient: check its reference'),
    ],
)
def test_what_tells_nothing_is_refused(signal, message):
    with pytest.raises(InputError, match=message):
        decay_of(signal, AMBIENT_PRESSURE)


@needs_measured_data
@pytest.mark.parametrize('name', ['Aluminium', 'Formlabs', 'Prusa', 'Ultimaker_006'])
def test_measured_decays_err_by_less_than_twice_the_noise_on_the_half_that_was_not_fitted(name):
    recording = read_recording(ROOT / 'chamber_decay' / f'{name}.csv', mapping=DECAYS)
    assert recording.rests
    told = decay_of(recording.cylinders['cylinder_a'].pressure, AMBIENT_PRESSURE)
    assert told.best.error < 2.0 * told.noise
    assert not any(leak.excluded for leak in told.leaks), 'the pressure falls by a hundredth: no law is told'
    assert bool(told.best.settling) == (name == 'Prusa')
