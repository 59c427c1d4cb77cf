"""No message ends a node: every extreme of every field, after each of which a sane message is answered as before."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import islice, product
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from graph import MILLISECOND, Graph, SimClient, ros_arguments, unique_namespace
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Header

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CONTACT_FORCE,
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_COMMAND,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.nodes.messages import LATEST, nanoseconds, stamp_message
from cfd_pneumatic.nodes.samples import message_class
from cfd_pneumatic.units import PSI

NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e155, 1e13, 5e-324, -0.0)
TEXTS = ('', 'x' * 100_000, 'Kolben ü \U0001f527\n\t\x1b[31m"\'{}%s', '/')
TIMES = tuple(
    Time(sec=sec, nanosec=rest) for sec, rest in product((-(2**31), -1, 2**31 - 1), (0, 10**9 - 1, 10**9, 2**32 - 1))
)
NO_TIMES = tuple(time for time in TIMES if time.sec < 0 or time.nanosec >= 10**9)
SANE = 10**18
REST = AMBIENT_PRESSURE + 10 * PSI


def headers() -> Iterator[Header]:
    yield from (Header(stamp=time, frame_id='cfd') for time in TIMES)
    yield from (Header(stamp=stamp_message(SANE), frame_id=text) for text in TEXTS)


def pistons() -> Iterator[JointState]:
    yield from (JointState(header=header, name=['piston'], position=[0.0]) for header in headers())
    header = Header(stamp=stamp_message(SANE))
    for value in NUMBERS:
        yield JointState(header=header, name=['piston'], position=[value], velocity=[value], effort=[value])
    for names, positions in (
        ([], []),
        ([], [0.0]),
        (['piston'], []),
        (['elbow'], [0.0]),
        (['elbow', 'piston'], [0.0]),
        (['piston'], [0.0, 1.0]),
        (['piston', 'piston'], [0.0, math.nan]),
        (list(TEXTS), [0.0] * len(TEXTS)),
        ([f'joint {index}' for index in range(10_000)], [0.0]),
        (['piston'], [0.0] * 200_000),
        (['piston'] * 10_000, []),
    ):
        yield JointState(header=header, name=names, position=positions)


def reliable(namespace: str, *topics: str) -> dict[str, str]:
    """Return parameters with which no message is lost on a busy machine."""
    return {f'qos_overrides.{namespace}/{topic}.subscription.reliability': 'reliable' for topic in topics}


def counted(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def test_sim_node_answers_a_sane_sample_after_every_message(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace, reliable(namespace, PISTON_STATE))):
        sim = SimClient(graph, namespace).meet()
        stamp = SANE

        def is_answered() -> None:
            nonlocal stamp
            stamp += MILLISECOND
            sim.sample(stamp, 0.0)

        for message in pistons():
            sim.piston_out.publish(message)
            is_answered()
        assert sim.count('ignored stamps') == len(NO_TIMES)
        for value in NUMBERS:
            sim.setpoint(0, value)
            sim.setpoint(1, value)
            sim.force_setpoint(value)
            is_answered()
        assert all(message.header.stamp.sec >= 0 for messages in sim.heard.values() for message in messages)
        bad = JointState(header=Header(stamp=NO_TIMES[-1]), name=['piston'], position=[0.0])
        status = graph.next_diagnostics(
            sim.node, lambda status: 'no time' in status.message, doing=lambda: sim.piston_out.publish(bad)
        )
        assert status.level != DiagnosticStatus.OK


def test_no_preview_leaves_the_range_of_stamps(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace)):
        sim = SimClient(graph, namespace).meet()
        sim.sample(LATEST, 0.0)
        graph.next_diagnostics(sim.node, lambda status: 'silent' in status.message)
        sim.sample(LATEST - 900 * MILLISECOND, 0.0)
        graph.next_diagnostics(sim.node, lambda status: 'silent' in status.message)
        pressures = sim.series(pressure_topic('cylinder_a'), previews=True)
        assert LATEST - 900 * MILLISECOND < pressures[-1][0] <= LATEST, 'the last one is a preview'
        sim.sample(SANE, 0.0)


def test_monitor_node_predicts_a_sane_sample_after_every_message_and_learns(graph: Graph) -> None:
    namespace = unique_namespace()
    topics = (PISTON_STATE, *map(pressure_topic, CYLINDERS), MEASURED_FORCE)
    settings = {'learning': 2.0, 'block': 0.02, 'timeout': 60.0, **reliable(namespace, *topics)}
    with graph.run('monitor_node', ros_arguments(namespace, settings)):
        node = f'{namespace}/monitor_node'
        piston_out = graph.publisher(JointState, f'{namespace}/{PISTON_STATE}')
        pressures_out = [graph.publisher(FluidPressure, f'{namespace}/{topic}') for topic in topics[1:3]]
        force_out = graph.publisher(WrenchStamped, f'{namespace}/{MEASURED_FORCE}')
        setpoint_out = graph.publisher(Float64, f'{namespace}/{setpoint_topic("cylinder_a")}')
        outs = [piston_out, *pressures_out, force_out, setpoint_out]
        graph.until(lambda: all(out.get_subscription_count() for out in outs))
        predicted = graph.listen(FluidPressure, f'{namespace}/{PREDICTED}{pressure_topic("cylinder_a")}')
        stamp = SANE

        def sample() -> None:
            nonlocal stamp
            stamp += 2 * MILLISECOND
            header = Header(stamp=stamp_message(stamp))
            piston_out.publish(JointState(header=header, name=['piston'], position=[0.0]))
            for out in pressures_out:
                out.publish(FluidPressure(header=header, fluid_pressure=REST + stamp % 7))
            force_out.publish(WrenchStamped(header=header))

        def is_answered(message: Any) -> None:
            sample()
            graph.until(lambda: predicted and nanoseconds(predicted[-1].header.stamp) == stamp)

        graph.until(lambda: predicted, doing=sample)
        for message in pistons():
            piston_out.publish(message)
            is_answered(message)
        for value in NUMBERS:
            setpoint_out.publish(Float64(data=value))
            is_answered(value)
        for header, value in [*((header, REST) for header in headers()), *((None, value) for value in NUMBERS)]:
            header = header or Header(stamp=stamp_message(stamp + MILLISECOND))
            for out in pressures_out:
                out.publish(FluidPressure(header=header, fluid_pressure=value, variance=value))
            force = WrenchStamped(header=header)
            force.wrench.force.x = force.wrench.torque.z = value
            force_out.publish(force)
            is_answered((header, value))

        def samples() -> None:
            for _ in range(50):
                sample()
            graph.until(lambda: nanoseconds(predicted[-1].header.stamp) == stamp)  # no faster than they are answered

        status = graph.next_diagnostics(node, lambda status: status.name.endswith('feed'))
        assert int(counted(status)['ignored stamps']) == 4 * len(NO_TIMES)
        for name in (*CYLINDERS, CONTACT_FORCE):
            graph.next_diagnostics(
                node,
                lambda one, name=name: one.name.endswith(name) and not one.message.startswith('learning'),
                doing=samples,
            )


def test_monitor_node_learns_from_signals_that_never_change(graph: Graph) -> None:
    """It died of a residual whose spread was nothing."""
    namespace = unique_namespace()
    topics = (PISTON_STATE, *map(pressure_topic, CYLINDERS), MEASURED_FORCE)
    settings = {'learning': 2.0, 'block': 0.02, 'timeout': 60.0, **reliable(namespace, *topics)}
    with graph.run('monitor_node', ros_arguments(namespace, settings)):
        piston_out = graph.publisher(JointState, f'{namespace}/{PISTON_STATE}')
        pressures_out = [graph.publisher(FluidPressure, f'{namespace}/{topic}') for topic in topics[1:3]]
        force_out = graph.publisher(WrenchStamped, f'{namespace}/{MEASURED_FORCE}')
        outs = [piston_out, *pressures_out, force_out]
        graph.until(lambda: all(out.get_subscription_count() for out in outs))
        predicted = graph.listen(FluidPressure, f'{namespace}/{PREDICTED}{pressure_topic("cylinder_a")}')
        stamps = iter(range(SANE, LATEST, 2 * MILLISECOND))

        def samples() -> None:
            for stamp in islice(stamps, 50):
                header = Header(stamp=stamp_message(stamp))
                piston_out.publish(JointState(header=header, name=['piston'], position=[0.0]))
                for out in pressures_out:
                    out.publish(FluidPressure(header=header, fluid_pressure=REST))
                force_out.publish(WrenchStamped(header=header))
            graph.until(lambda: predicted and nanoseconds(predicted[-1].header.stamp) == stamp)

        for name in (*CYLINDERS, CONTACT_FORCE):
            graph.next_diagnostics(
                f'{namespace}/monitor_node',
                lambda one, name=name: one.name.endswith(name) and not one.message.startswith('learning'),
                doing=samples,
            )


def test_rig_node_obeys_after_every_message(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('rig_node', ros_arguments(namespace)):
        outs = [
            graph.publisher(Float64, f'{namespace}/{topic}')
            for topic in (PISTON_COMMAND, *map(setpoint_topic, CYLINDERS))
        ]
        heard = graph.listen(JointState, f'{namespace}/{PISTON_STATE}')
        graph.until(lambda: all(out.get_subscription_count() for out in outs))
        for index, value in enumerate(NUMBERS):
            for out in outs:
                out.publish(Float64(data=value))
            sane = 1e-3 * (-1) ** index
            outs[0].publish(Float64(data=sane))
            graph.until(lambda sane=sane: heard and abs(heard[-1].position[0] - sane) < 1e-4)


def test_recorder_node_records_every_message(graph: Graph, tmp_path: Path) -> None:
    namespace, bag = unique_namespace(), tmp_path / 'bag'
    topic = f'{namespace}/{PISTON_STATE}'
    out = graph.publisher(JointState, topic)
    arguments = ros_arguments(namespace, {'topics': f'[{topic}]', 'output': bag})
    with graph.run('recorder_node', arguments) as process:
        graph.until(lambda: out.get_subscription_count() and f'recording {topic}' in process.stderr)
        messages = list(pistons())
        for message in messages:
            out.publish(message)
        assert out.wait_for_all_acked()
        assert graph.get(f'{namespace}/recorder_node', 'output') == [str(bag)]  # behind the messages
    with Reader(bag) as reader:
        assert reader.message_count == len(messages)
    with pytest.raises(ImportError):  # a topic of another system
        message_class('HelloWorld')


def test_a_clock_that_is_no_time_changes_nothing(graph: Graph, tmp_path: Path) -> None:
    clock = graph.publisher(Clock, '/clock')
    modules = ('sim_node', 'monitor_node', 'identifier_node', 'rig_node', 'recorder_node')
    namespace = unique_namespace()
    parameters = {'use_sim_time': True, 'topics': '[/nothing]', 'output': tmp_path / 'bag'}
    with ExitStack() as running:
        for module in modules:
            running.enter_context(graph.run(module, ros_arguments(namespace, parameters)))
        graph.until(lambda: clock.get_subscription_count() == len(modules))
        for time, module in product(NO_TIMES, modules):
            clock.publish(Clock(clock=time))
            assert graph.set(f'{namespace}/{module}', use_sim_time=True).successful  # which rclpy tells with a stamp


def test_what_is_stamped_with_the_last_time_of_a_clock_is_survived(graph: Graph) -> None:
    clock = graph.publisher(Clock, '/clock')
    last = Clock(clock=stamp_message(LATEST))
    sim, device = unique_namespace(), unique_namespace()
    schedule = {'use_sim_time': True, 'schedule': 'paper_step', 'start_subscribers': 1}
    with (
        graph.run('sim_node', ros_arguments(sim, {'use_sim_time': True})),
        graph.run('rig_node', ros_arguments(device, schedule)) as rig,
    ):
        client = SimClient(graph, sim).meet()  # there is one answer to the last time, which must not be missed
        graph.until(
            lambda: any(
                message.header.stamp.sec == 2**31 - 1 for message in client.heard[pressure_topic('cylinder_a')]
            ),
            doing=lambda: (clock.publish(last), client.send(0, 0.0)),
        )
        client.sample(SANE, 0.0)
        graph.listen(JointState, f'{device}/{PISTON_STATE}')
        graph.until(lambda: 'no stamp is left' in rig.stderr, doing=lambda: clock.publish(last))
        graph.until(lambda: 'played 350 samples' in rig.stderr)


PARAMETER_VALUES = (
    *(ParameterValue(type=3, double_value=value) for value in (*NUMBERS, sys.float_info.max)),
    *(ParameterValue(type=8, double_array_value=[value] * count) for value in NUMBERS for count in (1, 4)),
    *(ParameterValue(type=8, double_array_value=values) for values in ([], [1.0] * 100_000)),
    *(ParameterValue(type=2, integer_value=value) for value in (-(2**63), 2**63 - 1, 0)),
    *(ParameterValue(type=7, integer_array_value=values) for values in ([], [2**63 - 1])),
    *(ParameterValue(type=4, string_value=text) for text in TEXTS),
    *(ParameterValue(type=9, string_array_value=texts) for texts in ([], TEXTS, [''] * 10_000)),
    *(ParameterValue(type=1, bool_value=value) for value in (False, True)),
    *(ParameterValue(type=kind) for kind in (0, 5, 6, 10, 200, 255)),
)


@pytest.mark.parametrize('module', ['sim_node', 'monitor_node', 'identifier_node', 'rig_node', 'recorder_node'])
def test_no_value_of_a_parameter_ends_a_node(graph: Graph, tmp_path: Path, module: str) -> None:
    namespace = unique_namespace()
    node = f'{namespace}/{module}'
    needed = {'topics': '[/nothing]', 'output': tmp_path / 'bag'} if module == 'recorder_node' else {}

    def put(parameters: Iterable[Parameter]) -> list[Any]:
        request = SetParameters.Request(parameters=list(parameters))
        return graph.call(SetParameters, f'{node}/set_parameters', request).results

    with graph.run(module, ros_arguments(namespace, needed)):
        names = graph.call(ListParameters, f'{node}/list_parameters').result.names
        names = [name for name in names if name.count('.') < 2]  # those of effects are alike
        for name in (*names, '', 'not_there'):
            results = put(Parameter(name=name, value=value) for value in PARAMETER_VALUES)
            assert len(results) == len(PARAMETER_VALUES)
        if module == 'sim_node':
            put([Parameter(name='joint', value=ParameterValue(type=4, string_value='piston'))])
            put([Parameter(name='frame_id', value=ParameterValue(type=4, string_value='cfd'))])
            SimClient(graph, namespace).meet().sample(SANE, 0.0)


def test_identifier_node_refuses_what_the_system_cannot_take(graph: Graph, tmp_path: Path) -> None:
    namespace = unique_namespace()
    node = f'{namespace}/identifier_node'
    good = {'bags': [str(tmp_path)], 'split': '60/20/20', 'apply_to': ''}
    with graph.run('identifier_node', ros_arguments(namespace, {'output_dir': tmp_path / 'out'})):
        assert graph.set(node, bags=good['bags']).successful
        for name, value, why in (
            ('bags', ['x' * 5000], 'File name too long'),
            ('split', 'x' * 200_000, 'Argument list too long'),
            ('apply_to', '{nobody}', "parameter 'apply_to' is '{nobody}'"),
            ('apply_to', 'x' * 300, "parameter 'apply_to' is"),
        ):
            assert graph.set(node, **{name: value}).successful
            answer = graph.trigger(f'{node}/identify')
            assert not answer.success
            assert why in answer.message
            assert graph.set(node, **{name: good[name]}).successful
        assert graph.trigger(f'{node}/identify').success
