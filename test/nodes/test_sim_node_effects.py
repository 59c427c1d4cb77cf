# SPDX-License-Identifier: Apache-2.0
"""Physical effects as parameters of `sim_node`: set live and from a file."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from graph import MILLISECOND, Graph, SimClient, ros_arguments, unique_namespace
from rcl_interfaces.srv import DescribeParameters
from rclpy.parameter import Parameter

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CONTACT_FORCE, CYLINDERS, pressure_topic, setpoint_applied_topic
from cfd_pneumatic.model import TABLE_1, Cylinder, DeviceModel, ForceGeometry, LiveDevice, composed, propagation
from cfd_pneumatic.model.effects import FORCE_PARTS, MODULES, PRESSURE_EFFECTS
from cfd_pneumatic.nodes import sim_node
from cfd_pneumatic.nodes.messages import nanoseconds
from cfd_pneumatic.nodes.sim_node import SimNode
from cfd_pneumatic.units import PSI

PRESSURE_A, PRESSURE_B = map(pressure_topic, CYLINDERS)
AREA = 1.14e-3
REST = AMBIENT_PRESSURE + 10 * PSI
START = 2_000_000_000_000
PLAY = {
    'leakage': (2.0, 1.0),
    'sensor_lag': (0.01,),
    'lost_motion': (1e-4,),
    'valve_dead_band': (300.0,),
    'transport_delay': (0.005,),
    'setpoint_delay': (0.013,),
    'setpoint_lag': (0.02,),
}
"""Effects of each kind, with parameters."""

FORCE_PLAY = {
    'seal_friction': (2.0, 2e-5, 40.0, 1e-4),
    'stribeck_friction': (1.0, 5e-3, 3e-5),
    'force_offset': (-0.7,),
    'moving_mass': (0.4, 0.3),
    'force_curve': (1.0, 0.0, 5e-5, -1e-3, 1e-3, 0.0, 1e6, *(0.1 * knot for knot in range(17))),
}
"""Effects on the force, with parameters."""

SEAL_PLAY = 2e-6
BELOW = [(cylinder, PRESSURE_EFFECTS) for cylinder in CYLINDERS] + [(CONTACT_FORCE, FORCE_PARTS)]
"""Prefix of parameters, and the effects below it."""

Effects = dict[str, tuple[float, ...]]


def make_device(a: Effects, b: Effects | None = None, force: Effects | None = None) -> DeviceModel:
    cylinders = (Cylinder(TABLE_1, AMBIENT_PRESSURE, effects) for effects in (a, b or {}))
    return DeviceModel(*cylinders, ForceGeometry(AREA, 1.0, AMBIENT_PRESSURE), force or {}, SEAL_PLAY)


def settings(prefix: str, effects: Effects, enabled: bool = True) -> dict[str, float | bool]:
    """Return the parameters of a node that switch effects below a prefix on or off."""
    values: dict[str, float | bool] = {}
    for name, own in effects.items():
        values[f'{prefix}.{name}.enabled'] = enabled
        for parameter, value in zip(MODULES[name].EFFECT.parameters, own):
            values[f'{prefix}.{name}.{parameter.name}'] = value
    return values


def put(sim: SimClient, values: dict[str, float | bool]) -> None:
    result = sim.graph.set_atomically(sim.node, **{name.replace('.', '__'): value for name, value in values.items()})
    assert result.successful, result.reason


def stroke(stamp: int, position: float, count: int) -> list[tuple[int, float]]:
    """Return stamps and positions of a piston that moves on [ns, m]."""
    return [(stamp + 2 * MILLISECOND * index, position + 2e-5 * index) for index in range(1, count + 1)]


def assert_follows(sim: SimClient, live: LiveDevice, samples: list[tuple[int, float]]) -> None:
    """Assert that the node answers samples as the model does, to the last bit."""
    for stamp, position in samples:
        answer = sim.sample(stamp, position)
        live.sample(stamp, position, (REST, REST))
        state = live.committed.state
        assert (answer[PRESSURE_A], answer[PRESSURE_B]) == (state.a.reading, state.b.reading)
        assert answer[CONTACT_FORCE].x == live.device.contact_force(state)


@pytest.fixture(scope='module')
def node(graph: Graph) -> Iterator[SimNode]:
    """Return a node in this process, so that a test can look into its compiler."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sim_node, '_DIAGNOSTICS_PERIOD', 0.1)
        made = SimNode(context=graph.context, namespace=unique_namespace())
    with graph.run_here(made) as node:
        yield node


@pytest.fixture(scope='module')
def shared(graph: Graph, node: SimNode) -> SimClient:
    return SimClient(graph, node.get_namespace()).meet()


@pytest.fixture
def sim(shared: SimClient) -> SimClient:
    """Return a node at rest without effects."""
    for prefix, effects in BELOW:
        put(shared, settings(prefix, {name: effect.null for name, effect in effects.items()}, False))
    put(shared, {'contact_force.seal_play': SEAL_PLAY})
    return shared.restart()


def compiled() -> list[int]:
    """Return how many versions of each of the model's functions there are."""
    functions = (
        *(composed.step, composed.set_to_rest, composed.start_motion, composed.read_sensor),
        *(composed.step_force, composed.set_force_to_rest),
        *(propagation.advance, propagation.interpolate_gains),
    )
    return [len(function.signatures) for function in functions]


FRESH = """
import sys
sys.path[:0] = sys.argv[1:]
import rclpy
from test_sim_node_effects import SimNode, compiled
rclpy.init()
SimNode()
print(compiled())
"""


def test_a_node_is_warm_before_its_first_sample() -> None:
    """In a process of its own, where no other test has compiled anything."""
    program = [sys.executable, '-c', FRESH, *map(str, Path(__file__).parents[:2])]
    assert subprocess.run(program, capture_output=True, text=True, check=True).stdout.strip() == str([1] * 8)


def test_an_effect_switched_on_between_samples_acts_from_the_next_one_and_compiles_nothing(sim: SimClient) -> None:
    before = compiled()
    live = LiveDevice(make_device({}), max_gap=1.0)
    live.sample(START, 0.0, (REST, REST))
    sim.sample(START, 0.0)
    stamp, position = START, 0.0
    for name, own in PLAY.items():
        for enabled in (True, False):
            put(sim, settings('cylinder_a', {name: own}, enabled))
            live.device = make_device({name: own} if enabled else {})
            samples = stroke(stamp, position, 5)
            assert_follows(sim, live, samples)
            stamp, position = samples[-1]
    assert compiled() == before


def test_an_effect_on_the_force_switched_on_between_samples_acts_from_the_next_one_and_compiles_nothing(
    sim: SimClient,
) -> None:
    before = compiled()
    live = LiveDevice(make_device({}), max_gap=1.0)
    live.sample(START, 0.0, (REST, REST))
    sim.sample(START, 0.0)
    stamp, position = START, 0.0
    for effects in [*({name: own} for name, own in FORCE_PLAY.items()), FORCE_PLAY]:
        for enabled in (True, False):
            put(sim, settings(CONTACT_FORCE, effects, enabled))
            live.device = make_device({}, force=effects if enabled else {})
            samples = stroke(stamp, position, 5)
            assert_follows(sim, live, samples)
            stamp, position = samples[-1]
            state = live.committed.state
            assert (live.device.contact_force(state) != (state.a.p - state.b.p) * AREA) == enabled
    assert compiled() == before


def test_the_seals_play_is_a_parameter(sim: SimClient) -> None:
    put(sim, {**settings(CONTACT_FORCE, FORCE_PLAY), 'contact_force.seal_play': 1e-4})
    live = LiveDevice(replace(make_device({}, force=FORCE_PLAY), seal_play=1e-4), max_gap=1.0)
    assert_follows(sim, live, [(START, 0.0), *stroke(START, 0.0, 10)])
    stretched = live.committed.state.force.values[0]
    assert 0.0 < stretched < 1.0
    live.device = make_device({}, force=FORCE_PLAY)
    put(sim, {'contact_force.seal_play': SEAL_PLAY})
    assert_follows(sim, live, stroke(live.committed.stamp, live.committed.position, 10))
    assert live.committed.state.force.values[0] > stretched


@pytest.mark.parametrize('name', PRESSURE_EFFECTS)
def test_an_effect_can_be_enabled_alone_and_then_changes_nothing(sim: SimClient, name: str) -> None:
    put(sim, {f'cylinder_a.{name}.enabled': True})
    live = LiveDevice(make_device({name: PRESSURE_EFFECTS[name].null}), max_gap=1.0)
    plain = LiveDevice(make_device({}), max_gap=1.0)
    samples = [(START, 0.0), *stroke(START, 0.0, 5)]
    assert_follows(sim, live, samples)
    for stamp, position in samples:
        plain.sample(stamp, position, (REST, REST))
    # Runge-Kutta is not exact
    assert live.committed.state.a.reading == pytest.approx(plain.committed.state.a.reading, abs=15.0)
    assert live.committed.state.b == plain.committed.state.b


def test_both_cylinders_have_effects_of_their_own(sim: SimClient) -> None:
    b = {'leakage': (5.0, 0.0), 'sensor_lag': (0.005,)}
    put(sim, {**settings('cylinder_a', PLAY), **settings('cylinder_b', b)})
    live = LiveDevice(make_device(PLAY, b), max_gap=1.0)
    assert_follows(sim, live, [(START, 0.0), *stroke(START, 0.0, 20)])
    assert live.committed.state.a.reading != live.committed.state.a.p


def test_set_points_of_the_topic_act_late(sim: SimClient) -> None:
    """The node says which set-point was commanded; the pressure follows it as the model's does, to the last bit."""
    effects = {'setpoint_delay': (0.013,), 'setpoint_lag': (0.02,)}
    put(sim, settings('cylinder_a', effects))
    live = LiveDevice(make_device(effects), max_gap=1.0)
    applied_a, applied_b = map(setpoint_applied_topic, CYLINDERS)
    commanded, late = set(), []
    for index in range(60):
        if index % 15 == 5:
            sim.setpoint(0, (10 + index % 2) * PSI)
        stamp = START + 2 * MILLISECOND * index
        answer = sim.sample(stamp, 0.0)
        live.sample(stamp, 0.0, (answer[applied_a], answer[applied_b]))
        state = live.committed.state
        assert (answer[PRESSURE_A], answer[PRESSURE_B]) == (state.a.reading, state.b.reading)
        commanded.add(answer[applied_a])
        late.append(abs(answer[PRESSURE_A] - answer[applied_a]) > 0.9 * PSI)
    assert sorted(commanded) == pytest.approx([REST, REST + PSI])
    assert sum(late) > 6, 'for 13 ms the pressure does not move'
    sim.setpoint(0, 10 * PSI)
    sim.graph.until(
        lambda: (answer := sim.answer(sim.stamp)) is not None and answer[applied_a] == REST,
        doing=lambda: sim.send(sim.stamp + MILLISECOND, 0.0),
    )


def test_previews_read_the_sensor_too(sim: SimClient) -> None:
    effects = {'leakage': (5.0, 0.0)}
    put(sim, {**settings('cylinder_a', effects), **settings(CONTACT_FORCE, FORCE_PLAY)})
    live = LiveDevice(make_device(effects, force=FORCE_PLAY), max_gap=1.0)
    assert_follows(sim, live, [(START, 0.0), *stroke(START, 0.0, 5)])
    last = live.committed.stamp

    def after_last() -> bool:
        return all(messages and nanoseconds(messages[-1].header.stamp) > last for messages in sim.previews.values())

    sim.graph.until(after_last)
    for stamp, pressure in [one for one in sim.series(PRESSURE_A, previews=True) if one[0] > last]:
        expected = live.preview((stamp - last) * 1e-9, (REST, REST)).a.reading
        assert pressure == pytest.approx(expected, abs=1e-3)
    ahead_of_last = [one for one in sim.previews[CONTACT_FORCE] if nanoseconds(one.header.stamp) > last]
    assert ahead_of_last
    for message in ahead_of_last:
        ahead = live.preview((nanoseconds(message.header.stamp) - last) * 1e-9, (REST, REST))
        assert message.wrench.force.x == pytest.approx(live.device.contact_force(ahead), abs=1e-6)
    assert_follows(sim, live, stroke(last + 500 * MILLISECOND, 1e-4, 5))


@pytest.mark.parametrize(('name', 'value', 'reason'), [
    ('cylinder_a.leakage.conductance', -0.1, 'cylinder_a.leakage.conductance out of range Min: 0.0, Max: 100.0'),
    ('cylinder_a.leakage.conductance', math.nan, 'cylinder_a.leakage.conductance out of range'),
    ('cylinder_a.leakage.conductance', 1, 'leakage.conductance is INTEGER, and must be DOUBLE (write 1.0 for 1)'),
    ('cylinder_a.leakage.enabled', 1, 'cylinder_a.leakage.enabled is INTEGER, and must be BOOL'),
    ('cylinder_a.transport_delay.delay', 0.6, 'cylinder_a.transport_delay.delay out of range Min: -0.02, Max: 0.5'),
    ('contact_force.seal_friction.coulomb', -1.0, 'contact_force.seal_friction.coulomb out of range Min: 0.0'),
    ('contact_force.moving_mass.enabled', 1, 'contact_force.moving_mass.enabled is INTEGER, and must be BOOL'),
    ('contact_force.seal_play', -1e-6, 'contact_force.seal_play out of range Min: 0.0, Max: 0.001'),
])  # fmt: skip
def test_a_bad_value_is_rejected_with_its_reason_and_the_old_one_kept(
    sim: SimClient, name: str, value: object, reason: str
) -> None:
    before = sim.graph.get(sim.node, name)
    result = sim.graph.set(sim.node, **{name.replace('.', '__'): value})
    assert not result.successful
    assert reason in result.reason
    assert sim.graph.get(sim.node, name) == before


def test_every_effect_is_described_and_off(sim: SimClient) -> None:
    for above, effects in BELOW:
        for effect in effects.values():
            prefix = f'{above}.{effect.name}'
            names = [f'{prefix}.enabled', *(f'{prefix}.{parameter.name}' for parameter in effect.parameters)]
            assert sim.graph.get(sim.node, *names) == [False, *effect.null]
            request = DescribeParameters.Request(names=names)
            enabled, *own = sim.graph.call(DescribeParameters, f'{sim.node}/describe_parameters', request).descriptors
            assert enabled.type == Parameter.Type.BOOL.value
            assert effect.description in enabled.description
            for parameter, descriptor in zip(effect.parameters, own):
                (bounds,) = descriptor.floating_point_range
                assert (bounds.from_value, bounds.to_value) == (parameter.lower, parameter.upper)
                assert parameter.description in descriptor.description
                assert descriptor.description.endswith(f'[{parameter.unit}]')


def test_diagnostics_list_the_effects_that_are_on(sim: SimClient) -> None:
    put(sim, settings('cylinder_a', {'leakage': (0.0, 0.0), 'sensor_lag': (0.01,)}))
    put(sim, settings(CONTACT_FORCE, {'seal_friction': (2.0, 0.0, 0.0, 1e-4)}))
    status = sim.graph.next_diagnostics(sim.node, lambda _: True)
    values = {value.key: value.value for value in status.values}
    assert values['cylinder_a effects'] == 'leakage, sensor_lag'
    assert values['cylinder_b effects'] == 'none'
    assert values['contact_force effects'] == 'seal_friction'


def test_effects_that_leave_the_range_of_numbers_start_the_node_anew(sim: SimClient) -> None:
    resets = sim.count('resets')
    put(sim, settings('cylinder_a', {'operating_point': (0.5, 1e6, 1.0)}))
    sim.sample(START, 0.0)
    assert sim.sample(START + MILLISECOND, 0.5)[PRESSURE_A] == REST, 'a root of a negative pressure'
    assert sim.count('resets') == resets + 1
    sim.sample(START + 2 * MILLISECOND, 0.5)


def test_a_parameter_file_with_effects_runs_as_it_is(graph: Graph, tmp_path: Path) -> None:
    lines = ['/**:', '  ros__parameters:']
    for prefix, effects in (('cylinder_a', PLAY), ('cylinder_b', PLAY), (CONTACT_FORCE, FORCE_PLAY)):
        lines.append(f'    {prefix}:')
        for name, own in effects.items():
            lines += [f'      {name}:', '        enabled: true']
            lines += [
                f'        {parameter.name}: {value:.6f}'
                for parameter, value in zip(MODULES[name].EFFECT.parameters, own)
            ]
    file = tmp_path / 'parameters.yaml'
    file.write_text('\n'.join(lines) + '\n')
    namespace = unique_namespace()
    with graph.run('sim_node', [*ros_arguments(namespace), '--params-file', str(file)]) as process:
        sim = SimClient(graph, namespace).meet()
        live = LiveDevice(make_device(PLAY, PLAY, FORCE_PLAY), max_gap=1.0)
        assert_follows(sim, live, [(START, 0.0), *stroke(START, 0.0, 20)])
        assert 'ffects' not in process.stderr
