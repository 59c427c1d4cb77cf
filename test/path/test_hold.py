# SPDX-License-Identifier: Apache-2.0
"""Set-points that hold the force: the formula of the linear model, limits, delays, and the rig."""

from __future__ import annotations

import numpy as np
import pytest
from known_device import KNOWN, identified_folder, surface

from cfd_pneumatic.path import IdentifiedDevice, force_on_path
from cfd_pneumatic.path.simulation import acting_at, delayed
from cfd_pneumatic.rig import device_named, record, written_schedule

DEAD_TIME = KNOWN.with_values(
    {
        f'{cylinder}.{effect}.{name}': value
        for cylinder in ('cylinder_a', 'cylinder_b')
        for effect, values in (
            ('setpoint_delay', {'enabled': True, 'delay': 0.03}),
            ('setpoint_lag', {'enabled': True, 'lag': 0.02}),
        )
        for name, value in values.items()
    }
)


def held(device=KNOWN, **options):
    return force_on_path(IdentifiedDevice.of_device(device), surface(), force=20.0, feed=0.1, hold=True, **options)


@pytest.mark.parametrize('device', [KNOWN, DEAD_TIME], ids=['direct', 'late command'])
def test_held_setpoints_reduce_the_force_error(device):
    preview = held(device)
    assert preview.held.prediction.rms_error < 0.2 * preview.constant.rms_error


def test_held_setpoints_follow_the_formula_of_the_linear_model():
    """Away from reversals of the piston, p_d = p* + K_x v / K with the branch that acts."""
    preview = held(rate=250.0)
    path = preview.constant.path
    times = path.grid[path.is_on_path]
    speed = path.speed_at(times)
    far = np.ones(times.size, dtype=bool)
    for reversal in times[1:][np.diff(np.sign(speed)) != 0.0]:
        far &= np.abs(times - reversal) > 0.1
    far &= (times > 0.2) & (times < path.duration - 0.2)
    assert np.count_nonzero(far) > 100
    gains = {'cylinder_a': (6e6, 150.0, 30.0, 1.0), 'cylinder_b': (5e6, 140.0, 28.0, -1.0)}
    for name, (k_x, k_sv, k_v, sign) in gains.items():
        rate = sign * speed
        lead = k_x * rate / np.where(rate > 0.0, k_sv, k_v)
        found = acting_at(preview.held.prediction.setpoints[name], times)
        error = (found - np.mean(found[far])) - (lead - np.mean(lead[far]))
        assert np.sqrt(np.mean(error[far] ** 2)) < 0.15 * np.std(lead)


def test_limits_of_the_regulators_are_kept():
    slew, limits = 2e4, (40e3, 79e3)
    preview = held(slew=slew, limits=limits, rate=50.0)
    for level in preview.held.prediction.setpoints.values():
        assert np.min(level.values) >= limits[0]
        assert np.max(level.values) <= limits[1]
        assert np.max(np.abs(np.diff(level.values))) <= slew / 50.0 * (1.0 + 1e-9)
    assert preview.held.prediction.rms_error < preview.constant.rms_error


def test_the_benefit_is_lost_at_the_latest_arrival():
    from cfd_pneumatic.path.simulation import PathSimulator

    preview = held()
    simulator = PathSimulator(preview.constant.path)
    late = simulator.simulate(KNOWN, delayed(preview.held.prediction.setpoints, preview.held.latest)).force
    error = late[preview.constant.path.is_on_path] - 20.0
    assert np.sqrt(np.mean(error**2)) == pytest.approx(preview.constant.rms_error, rel=0.03)


def test_no_benefit_is_promised_within_a_wide_band():
    assert held().held.is_promised
    assert not held(scan_error=1e-3).held.is_promised


def test_the_rig_holds_the_force(tmp_path):
    """Real: identify the rig's linear device, write the schedule, play it, and compare the true force."""
    folder = tmp_path / 'identified'
    identified_folder(str(folder))
    device = IdentifiedDevice.load(folder)
    ratios = []
    for hold in (False, True):
        preview = force_on_path(device, surface(3, 0.3), force=15.0, feed=0.06, hold=hold)
        preview.save(tmp_path / f'hold_{hold}')
        played = record(written_schedule(tmp_path / f'hold_{hold}' / 'schedule.csv'), device_named('paper'), seed=1)
        path = preview.constant.path
        force = np.interp(path.grid - path.grid[0], played.truth.times, played.truth.force)[path.is_on_path]
        prediction = preview.held.prediction if hold else preview.constant
        assert np.sqrt(np.mean((force - 15.0 - prediction.error) ** 2)) < 0.15 * preview.constant.rms_error
        ratios.append(np.sqrt(np.mean((force - 15.0) ** 2)))
    assert ratios[1] < 0.3 * ratios[0]
