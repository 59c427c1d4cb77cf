# SPDX-License-Identifier: Apache-2.0
"""The predicted force: compared with the stepping code of the nodes, with formulas, and with the rig."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_device import AREA, KNOWN, surface

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.path import IdentifiedDevice, PathMotion, Surface, force_on_path
from cfd_pneumatic.path.air import air_consumption
from cfd_pneumatic.path.feed import fastest_feed
from cfd_pneumatic.path.simulation import PathSimulator, without_sensor_effects
from cfd_pneumatic.recording import sampled

LEVELS = {'cylinder_a': 70e3, 'cylinder_b': 50e3}
WITH_EFFECTS = KNOWN.with_values(
    {
        'cylinder_a.leakage.enabled': True,
        'cylinder_a.leakage.conductance': 1.0,
        'cylinder_b.sensor_lag.enabled': True,
        'cylinder_b.sensor_lag.lag': 0.02,
        'contact_force.seal_friction.enabled': True,
        'contact_force.seal_friction.coulomb': 2.0,
    }
)


def preview(device=KNOWN, **options):
    defaults = {'force': 20.0, 'feed': 0.1}
    return force_on_path(IdentifiedDevice.of_device(device), surface(), **{**defaults, **options})


@pytest.mark.parametrize('device', [KNOWN, WITH_EFFECTS], ids=['linear', 'effects'])
def test_the_force_is_that_of_the_simulator_node(device):
    path = surface().at_feed(0.1)
    force = PathSimulator(path).simulate(device, LEVELS).force
    moved = sampled(path.grid, path.displacement_at(path.grid), {})
    stepped = without_sensor_effects(device).simulate(moved, setpoints=LEVELS, raw=True)
    settled = path.grid > 0.2  # the simulator node begins at the set-points, and a leak then lowers the pressure
    error = (force - stepped.force.values)[settled]
    assert np.sqrt(np.mean(error**2)) < 0.1  # the node's friction reverses half a sample later


def test_a_sensor_effect_does_not_change_the_force():
    path = surface().at_feed(0.1)
    lagging = KNOWN.with_values({'cylinder_a.sensor_lag.enabled': True, 'cylinder_a.sensor_lag.lag': 0.05})
    forces = [PathSimulator(path).simulate(device, LEVELS).force for device in (KNOWN, lagging)]
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-3)


def test_a_slope_costs_the_force_per_speed():
    """At constant speed each pressure differs from its set-point by K_x / K times the speed."""
    slope = Surface(np.linspace(0.0, 0.2, 201), np.linspace(0.0, 2e-3, 201))
    given_force = force_on_path(IdentifiedDevice.of_device(KNOWN), slope, force=20.0, feed=0.1)
    path = given_force.constant.path
    settled = given_force.constant.force[(path.grid > 1.0) & (path.grid < 1.9)]
    rest = given_force.constant.force[0]
    speed = 1e-3
    assert np.mean(settled) - rest == pytest.approx(-AREA * speed * (6e6 / 150.0 + 5e6 / 28.0), rel=1e-3)
    assert given_force.causes.per_speed.growing == pytest.approx(AREA * (6e6 / 150.0 + 5e6 / 28.0))
    assert given_force.causes.per_speed.shrinking == pytest.approx(AREA * (6e6 / 30.0 + 5e6 / 140.0))


@pytest.mark.parametrize('force', [5.0, 40.0, -15.0])
@pytest.mark.parametrize('device', [KNOWN, WITH_EFFECTS], ids=['linear', 'effects'])
def test_the_constant_setpoints_centre_the_force(device, force):
    constant = preview(device, force=force).constant
    assert np.mean(constant.error) == pytest.approx(0.0, abs=1.1e-3 * abs(force))


def test_a_single_cylinder_gives_forces_of_one_sign():
    single = KNOWN.with_values({'cylinder_b.enabled': False})
    assert np.mean(preview(single).constant.error) == pytest.approx(0.0, abs=0.03)
    with pytest.raises(InputError, match='only cylinder_a, which gives forces of the opposite sign'):
        preview(single, force=-20.0)


def test_violations_are_where_the_force_leaves_the_tolerance():
    given_force = preview(tolerance=1.0, scan_error=2e-5)
    constant = given_force.constant
    times, size = constant.path.grid[constant.path.is_on_path], np.abs(constant.error)
    half = constant.half_band[constant.path.is_on_path]
    inside = np.zeros(times.size, dtype=bool)
    for violation in constant.violations:
        part = (times >= violation.begin) & (times <= violation.end)
        inside |= part
        assert violation.is_certain == bool(np.any(size[part] - half[part] > 1.0))
    np.testing.assert_array_equal(inside, size + half > 1.0)
    assert 0 < np.count_nonzero(inside) < times.size


def test_the_band_of_the_parameters_is_that_of_random_devices():
    """Known truth: gains with independent errors of 5 % give forces that spread as the band says."""
    random = np.random.default_rng(5)
    names = ('k_x', 'k_sv', 'k_v')
    nominal = [KNOWN.value(f'cylinder_a.{name}')[0] for name in names]

    class Identified(IdentifiedDevice):
        def deviations(self, share=1.0):
            return [
                ('cylinder_a', {f'cylinder_a.{name}': ((1.0 + 0.05 * share) * value,)})
                for name, value in zip(names, nominal)
            ]

    path = surface()
    predicted = force_on_path(Identified(KNOWN), path, force=20.0, feed=0.1).constant
    simulator = PathSimulator(predicted.path)
    forces = []
    for _ in range(60):
        changed = {
            f'cylinder_a.{name}': (value * (1.0 + 0.05 * random.standard_normal()),)
            for name, value in zip(names, nominal)
        }
        forces.append(simulator.simulate(KNOWN.with_values(changed), predicted.setpoints).force)
    spread = np.std(forces, axis=0)[predicted.path.is_on_path]
    half = predicted.half_band[predicted.path.is_on_path] / 1.96
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(np.sqrt(np.mean(half**2)), rel=0.25)


def test_a_wrong_scan_widens_the_band_as_wrong_surfaces_do():
    random = np.random.default_rng(8)
    constant = preview(scan_error=5e-5).constant
    path = constant.path
    errors = []
    for _ in range(40):
        # independent of the band: sums of cosines with the band's correlation length of 5 mm at 0.1 m/s
        waves = random.normal(0.0, 1.0 / (np.sqrt(2.0) * 0.05), 200)
        phases = random.uniform(0.0, 2.0 * np.pi, 200)
        noise = np.sqrt(2.0 / 200) * np.sum(np.cos(np.outer(path.grid, waves) + phases), axis=1)
        wrong = PathSimulator(path, np.where(path.is_on_path, 5e-5 * noise, 0.0))
        errors.append(wrong.simulate(KNOWN, constant.setpoints).force - constant.force)
    inner = (path.grid > 0.2) & (path.grid < path.duration - 0.2)
    spread, half = np.std(errors, axis=0)[inner], constant.half_band[inner] / 1.96
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(np.sqrt(np.mean(half**2)), rel=0.3)


def test_the_fastest_feed_keeps_the_tolerance_and_no_faster_feed_does():
    tolerance = 2.0
    feed = preview(tolerance=tolerance).feed
    assert feed is not None
    assert feed.predicted is not None
    assert feed.with_band is not None
    levels = preview().levels

    def largest(at):
        path = surface().at_feed(at)
        response = PathSimulator(path).simulate(KNOWN, levels)
        return np.max(np.abs(response.force[path.is_on_path] - 20.0))

    assert largest(0.97 * feed.predicted) < tolerance < largest(1.03 * feed.predicted)
    assert feed.with_band <= 1.01 * feed.predicted


@settings(max_examples=30)
@given(st.floats(1e-3, 5.0), st.floats(0.1, 10.0), st.floats(0.05, 15.0))
def test_the_search_for_a_feed_finds_the_root_of_any_growing_error(root, power, share):
    found = fastest_feed(lambda feed: (feed / root) ** power, 0.01, 1.0, root * share)
    assert found == pytest.approx(root, rel=0.02)


def test_a_feed_is_not_searched_far_below_the_wanted_feed():
    assert fastest_feed(lambda feed: feed, 0.01, 1.0, 20.0) is None


def test_no_feed_keeps_a_tolerance_below_an_error_at_rest():
    assert fastest_feed(lambda feed: 2.0 + feed, 0.2, 1.0, 0.1) is None


def test_air_is_what_moves_into_the_chambers():
    """A sine at constant pressures: each cycle fills each chamber once by the swept volume at its pressure."""
    times = np.linspace(0.0, 10.0, 2001)
    path = PathMotion(times, 1e-3 * np.sin(2.0 * np.pi * times))
    pressures = {'cylinder_a': np.full(path.grid.size, 2e5), 'cylinder_b': np.full(path.grid.size, 1.5e5)}
    swept = AREA * 2e-3 * 1.0  # m^3/s
    assert air_consumption(KNOWN, path, pressures) == pytest.approx(swept * (2e5 + 1.5e5) / 1e5, rel=2e-3)


def test_a_leak_costs_air():
    leaking = KNOWN.with_values({'cylinder_a.leakage.enabled': True, 'cylinder_a.leakage.conductance': 0.42})
    rest = PathMotion(np.array([0.0, 1.0]), np.zeros(2))
    pressures = {'cylinder_a': np.full(rest.grid.size, 101_325.0 + 95e3)}
    volume = 1.963e5 * AREA / 6e6  # over the exponent
    expected = 0.42 * 95e3 * volume / 1e5
    assert air_consumption(leaking, rest, pressures) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'feed': 0.0}, 'must be a positive speed'),
        ({'feed': None}, 'which needs a feed'),
        ({'force': 0.0}, 'other than 0'),
        ({'force': 5e3}, 'the regulators reach'),
        ({'tolerance': -1.0}, 'tolerance must be above 0'),
        ({'scan_error': -1.0}, 'scan error must be 0 or above'),
        ({'rate': 0.0}, 'rate of set-points'),
        ({'limits': (2e5, 1e5)}, 'lower set-point first'),
        ({'feed': 1e-5}, 'Split the path'),
    ],
)
def test_bad_input_gives_one_line(options, message):
    with pytest.raises(InputError, match=message):
        preview(**options)


def test_a_device_without_an_area_is_refused():
    from cfd_pneumatic.device import Device

    unknown = Device({name: value for name, value in KNOWN.given.items() if name != 'area'})
    with pytest.raises(InputError, match='the area of the pistons is not known'):
        preview(unknown)


def test_a_path_outside_of_the_stroke_is_refused():
    short = KNOWN.with_values({'identified_displacement': (0.0, 3e-4)})
    with pytest.raises(InputError, match='closer to the surface'):
        preview(short)
