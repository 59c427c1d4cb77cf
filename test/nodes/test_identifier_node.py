# SPDX-License-Identifier: Apache-2.0
"""`identifier_node`: a bag identified in the background, and the result set on a running simulator."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from graph import Graph, Process, refusals, ros_arguments, unique_namespace
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.qos import DurabilityPolicy, QoSProfile
from reference import pressure, step_like, step_like_rate
from std_msgs.msg import String

from cfd_pneumatic.convention import AMBIENT_PRESSURE, PISTON_AREA
from cfd_pneumatic.model import NAMES, TABLE_1
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal, write_recording
from cfd_pneumatic.units import PSI

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SETPOINT = 10 * PSI
GAINS = (5e6, 15.0, 30.0, 0.01)
"""So slow that the pressure does not overshoot: the piston only ever moves out, and nothing excites K_v."""
IMPATIENT = 'import cfd_pneumatic.nodes.parameter_transfer as transfer; transfer._SERVICE_WAIT = 1.0'
"""Waits for a second for a target that is not there, and not for five."""
UNSET = {'bags': [''], 'output_dir': '', 'apply_to': '', 'split': '60/20/20', 'area': 0.0, 'geometric_factor': 0.0}


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of strokes outward, by an integrator of the test's own."""
    starts, amplitude = np.arange(0.1, 6.0, 0.5), 4e-4
    times = np.arange(0.0, 6.2, 0.002)
    displacement = sum(step_like(start, 0.03, amplitude)(times) for start in starts)

    def rate(time: float) -> float:
        return sum(step_like_rate(start, 0.03, amplitude)(time) for start in starts if start <= time <= start + 0.03)

    absolute = SETPOINT + AMBIENT_PRESSURE
    rng = np.random.default_rng(1)
    pressures = pressure(GAINS, lambda time: np.float64(rate(time)), absolute, times, steps=4)
    recording = Recording(
        name='strokes',
        epoch=10**18,
        displacement=Signal(times, displacement + rng.normal(0.0, 1e-6, times.size)),
        cylinders={
            'cylinder_a': CylinderSignals(
                pressure=Signal(times, pressures + rng.normal(0.0, 20.0, times.size)),
                setpoint=Signal(times[:1], np.array([absolute])),
            )
        },
        force=None,
        health=(),
    )
    path = tmp_path_factory.mktemp('bags') / 'strokes'
    write_recording(path, recording)
    return path


class Identifier:
    """A running `identifier_node` and what it says."""

    def __init__(self, graph: Graph, process: Process, name: str) -> None:
        self.graph, self.process, self.name = graph, process, name

    def set(self, **parameters: object) -> None:
        """Set these parameters, and those that tests set to what they were."""
        assert self.graph.set_atomically(self.name, **(UNSET | parameters)).successful

    def identify(self) -> None:
        answer = self.graph.trigger(f'{self.name}/identify')
        assert answer.success, answer.message

    def status(self, words: str) -> DiagnosticStatus:
        return self.graph.next_diagnostics(self.name, lambda status: words in status.message)

    def progress(self, least: float) -> None:
        """Wait until so many percent of the fit are done."""

        def is_fitting(status: DiagnosticStatus) -> bool:
            return any(value.key == 'progress [%]' and float(value.value) >= least for value in status.values)

        self.graph.next_diagnostics(self.name, is_fitting)

    def result(self) -> dict:
        """Return the report as one who comes late hears it."""
        heard = self.graph.listen(String, f'{self.name}/result', LATCHED)
        self.graph.until(lambda: heard)
        return json.loads(heard[0].data)


@contextmanager
def identifier(graph: Graph, root: Path, before: str = '', **parameters: object) -> Iterator[Identifier]:
    """Run a node that may read and write below a folder."""
    namespace = unique_namespace()
    parameters = {'input_folders': f'[{root}]', 'output_folder': root, **parameters}
    with graph.run('identifier_node', ros_arguments(namespace, parameters), before=before) as process:
        yield Identifier(graph, process, f'{namespace}/identifier_node')


@pytest.fixture(scope='module')
def node(graph: Graph, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Identifier]:
    with identifier(graph, tmp_path_factory.getbasetemp()) as node:
        yield node


@contextmanager
def earlier_results(folder: Path) -> Iterator[Path]:
    """Put results into a folder that have to outlive what happens."""
    folder.mkdir(parents=True)
    contents = {'report.json': '{"schema": 1, "recordings": []}', 'parameters.yaml': '# identify_bag, run earlier\n'}
    for name, content in contents.items():
        (folder / name).write_text(content)
    yield folder
    assert {path.name: path.read_text() for path in folder.iterdir()} == contents


def test_a_bag_is_identified_and_set_on_the_simulator(
    graph: Graph, node: Identifier, bag: Path, tmp_path: Path
) -> None:
    output, simulator = tmp_path / 'out', unique_namespace()
    target = f'{simulator}/sim_node'
    with graph.run('sim_node', ros_arguments(simulator)):
        node.set(bags=[str(bag)], output_dir=str(output), apply_to=target, area=7e-4, geometric_factor=1.5)
        effects = ('cylinder_a.leakage', 'cylinder_b.leakage', 'contact_force.force_offset')
        switches = [f'{effect}.enabled' for effect in effects]
        assert graph.set_atomically(target, **dict.fromkeys(switches, True)).successful
        node.identify()
        second = graph.trigger(f'{node.name}/identify')
        assert not second.success
        assert second.message == 'refused: an identification is running; ~/cancel ends it'
        status = node.status(f'parameters set on {target}')
        assert f', but cylinder_b.enabled is true there: start it with {output}/parameters.yaml.' in status.message
        assert status.level == DiagnosticStatus.WARN
        assert graph.get(target, 'area', 'geometric_factor', 'cylinder_b.enabled') == [7e-4, 1.5, True]
        report = node.result()
        assert report == json.loads((output / 'report.json').read_text())
        assert report['schema'] == 1
        fitted = report['cylinders']['cylinder_a']['parameters']
        assert fitted['k_x']['value'] == pytest.approx(GAINS[0], rel=0.1)
        assert not fitted['k_v']['identifiable']

        file = yaml.safe_load((output / 'parameters.yaml').read_text())['/**']['ros__parameters']['cylinder_a']
        assert file['not_identifiable'] == ['k_v']
        names = ('setpoints', *NAMES, 'setpoint_offset', 'not_identifiable')
        assert graph.get(target, *(f'cylinder_a.{name}' for name in names)) == [file[name] for name in names]
        assert graph.get(target, 'cylinder_b.k_x') == [TABLE_1.k_x.tolist()]
        assert graph.get(target, *switches) == [False, True, True], 'off where it is not in what was identified'
        changed = ['area', *switches, *(f'cylinder_a.{name}' for name in names)]
        applied = graph.get(target, *changed)
        assert graph.trigger(f'{node.name}/revert').success
        node.status(f'parameters set on {target}')
        gains = [getattr(TABLE_1, name).tolist() for name in ('setpoints', *NAMES)]
        assert graph.get(target, *changed) == [PISTON_AREA, True, True, True, *gains, 0.0, ['']]
        assert graph.trigger(f'{node.name}/revert').success, 'what was taken back can be brought back'
        node.status(f'parameters set on {target}')
        assert graph.get(target, *changed) == applied
        graph.set(node.name, apply_to='none')
        node.identify()  # it can be asked again
        node.status(f'done. See {output}/report.json')


def test_a_target_that_is_missing_refuses_or_is_no_simulator_is_named(
    graph: Graph, node: Identifier, bag: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    namespace, root = unique_namespace(), tmp_path_factory.getbasetemp()

    def serve(name: str, knows: set[str] | None) -> None:
        def get(request: GetParameters.Request, response: GetParameters.Response) -> GetParameters.Response:
            number = ParameterValue(type=8, double_array_value=[1.0])
            response.values = [number if knows is None or name in knows else ParameterValue() for name in request.names]
            return response

        def refuse(_: object, response: SetParametersAtomically.Response) -> SetParametersAtomically.Response:
            response.result.reason = 'not today'
            return response

        graph.node.create_service(GetParameters, f'{namespace}/{name}/get_parameters', get)
        graph.node.create_service(SetParametersAtomically, f'{namespace}/{name}/set_parameters_atomically', refuse)

    serve('stubborn', None)
    serve('stranger', {'use_sim_time'})
    own, nobody = {'bags': f'[{bag}]', 'output_dir': tmp_path / 'own'}, f'{namespace}/nobody'
    with identifier(graph, root, IMPATIENT, apply_to=nobody, **own) as other:  # which waits for its target meanwhile
        other.identify()
        for target, words in (
            ('stubborn', f'{namespace}/stubborn refused the parameters: not today'),
            ('stranger', f'{namespace}/stranger (parameter apply_to) is no sim_node'),
        ):
            node.set(bags=[str(bag)], output_dir=str(tmp_path / target), apply_to=f'{namespace}/{target}')
            node.identify()
            assert node.status(words).level == DiagnosticStatus.ERROR
        assert other.status(f'{nobody} (parameter apply_to) does not answer').level == DiagnosticStatus.ERROR
        assert other.result()['schema'] == 1, 'the report is there all the same'


def test_what_cannot_begin_is_refused_with_the_reason(
    graph: Graph, node: Identifier, bag: Path, tmp_path: Path
) -> None:
    bags, output = [str(bag)], str(tmp_path)
    for parameters, reason in (
        ({}, "parameter 'bags' is empty"),
        ({'bags': bags}, "parameter 'output_dir' is empty"),
        ({'bags': [str(tmp_path / 'none')], 'output_dir': output}, 'none does not exist'),
        ({'bags': bags, 'output_dir': output, 'apply_to': 'no node'}, "parameter 'apply_to' is 'no node'"),
    ):
        node.set(**parameters)
        answer = graph.trigger(f'{node.name}/identify')
        assert not answer.success
        assert answer.message.startswith('refused: ')
        assert reason in answer.message
    assert not graph.trigger(f'{node.name}/cancel').success


def test_a_bad_bag_is_an_error_with_its_reason(node: Identifier, bag: Path, tmp_path: Path) -> None:
    bad = tmp_path / 'bad'
    bad.mkdir()
    with earlier_results(tmp_path / 'out') as output:
        node.set(bags=[str(bag), str(bad)], output_dir=str(output))
        node.identify()
        status = node.status('identify_bag: error: ')
        assert status.level == DiagnosticStatus.ERROR
        assert str(bad) in status.message
        assert 'Traceback' not in status.message


SECRET = 'correct horse battery staple'


def test_a_stranger_reads_no_file_of_the_node_s_user(
    graph: Graph, bag: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Anybody in the graph may set paths. Files elsewhere, hidden files and pipes are neither read nor quoted."""
    allowed, elsewhere = tmp_path / 'allowed', tmp_path / 'elsewhere'
    for folder in (allowed / '.hidden', allowed / 'linked', elsewhere):
        folder.mkdir(parents=True)
    own = allowed / 'own'
    shutil.copytree(bag, own)
    for place in (elsewhere / 'key', allowed / '.hidden' / 'key', allowed / 'key', allowed / 'table.csv'):
        place.write_text(f'{SECRET}\n' * 3)
    (allowed / 'link').symlink_to(elsewhere / 'key')
    (allowed / 'linked' / 'bag.mcap').symlink_to(elsewhere / 'key')
    (elsewhere / 'msg').mkdir()
    shutil.copy(next(bag.glob('*.mcap')), elsewhere / 'bag.mcap')
    hiding = allowed / 'hiding'
    hiding.mkdir()
    (hiding / '.bag.mcap').symlink_to(elsewhere / 'bag.mcap')
    metadata = (bag / 'metadata.yaml').read_text()
    (hiding / 'metadata.yaml').write_text(metadata.replace(next(bag.glob('*.mcap')).name, '.bag.mcap'))
    (allowed / 'linked' / 'inner').mkdir()
    (allowed / 'full').mkdir()
    for number in range(1001):
        (allowed / 'full' / str(number)).touch()
    os.mkfifo(allowed / 'pipe')
    columns = 'cylinder_a: {pressure: {column: 1, unit: Pa, reference: absolute}}'
    topics = 'cylinder_a: {pressure: {topic: a, unit: Pa, reference: absolute}}'
    (allowed / 'columns').write_text(f'table: {{time: {{column: 2, unit: s}}}}\n{columns}')
    (allowed / 'types').write_text(f'types: ../elsewhere\n{topics}')
    good = {'bags': [str(own)], 'mapping': '', 'output_dir': str(allowed / 'out')}
    requests = [
        *({'mapping': str(path)} for path in (elsewhere / 'key', allowed / '.hidden' / 'key', allowed / 'link')),
        *({'mapping': str(allowed / name)} for name in ('key', 'types', 'pipe', '../elsewhere/key', 'missing')),
        *({'bags': [str(path)]} for path in (elsewhere / 'key', allowed / 'linked', allowed / 'pipe', allowed / 'key')),
        *({'bags': [path]} for path in ('/', '/proc/self/environ', '/dev/zero', 'x' * 5000, 'null\0character')),
        *({'bags': [f'{allowed}/{name}']} for name in ('hiding', 'full', 'linked/inner/..', 'linked/../linked')),
        {'bags': [f'{own}/{"./" * number}' for number in range(101)]},
        {'bags': [str(allowed / 'table.csv')], 'mapping': str(allowed / 'columns')},
        *({'output_dir': str(path)} for path in (elsewhere / 'out', allowed / '.hidden' / 'out', allowed, '/', '~')),
    ]
    folders = {'input_folders': f'[{allowed}]', 'output_folder': allowed}
    before = sorted(elsewhere.rglob('*')), sorted((allowed / '.hidden').iterdir())
    with identifier(graph, tmp_path_factory.getbasetemp(), **folders) as node:
        heard, answers = graph.listen(DiagnosticArray, '/diagnostics'), []
        for request in requests:
            assert graph.set_atomically(node.name, **{**good, **request}).successful
            answers.append(graph.trigger(f'{node.name}/identify'))
            if answers[-1].success:
                status = graph.next_diagnostics(node.name, lambda one: one.level == DiagnosticStatus.ERROR)
                assert 'identify_bag: error' in status.message, request
        assert not graph.set(node.name, input_folders=['/']).successful
        said = node.process.stderr + repr(heard) + repr(answers)
    assert not any(word in said for word in SECRET.split())
    assert (sorted(elsewhere.rglob('*')), sorted((allowed / '.hidden').iterdir())) == before
    assert not (allowed / 'out').exists()


def test_the_home_folder_is_not_given_to_the_graph(tmp_path: Path) -> None:
    given = [{'input_folders': f'[{folder}]', 'output_folder': tmp_path} for folder in ('/', '~', '~/..')]
    lines = refusals('identifier_node', [ros_arguments(parameters=one) for one in given])
    assert all('is the home folder or above it' in line for line in lines)


def test_a_node_started_in_the_home_folder_says_what_it_needs(graph: Graph) -> None:
    name = unique_namespace()
    with graph.run('identifier_node', ros_arguments(name), before='import os; os.chdir("/")') as process:
        graph.until(lambda: process.stderr.count('requests are refused') == 2)
        assert graph.set_atomically(f'{name}/identifier_node', bags=['/etc'], output_dir='/tmp').successful
        assert "parameter 'input_folders' is not given" in graph.trigger(f'{name}/identifier_node/identify').message


def test_a_file_of_somebody_else_is_replaced_if_the_node_was_started_to_do_so(
    graph: Graph, node: Identifier, bag: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    page = tmp_path / 'parameters.yaml'
    page.write_text('mine')
    node.set(bags=[str(bag)], output_dir=str(tmp_path))
    node.identify()
    assert 'parameters.yaml' in node.status('identify_bag: error: ').message
    assert page.read_text() == 'mine'
    with identifier(graph, tmp_path_factory.getbasetemp(), overwrite=True) as other:
        other.set(bags=[str(bag)], output_dir=str(tmp_path))
        other.identify()
        other.status('done.')
    assert page.read_text() != 'mine'


ODD_NAMES = ('-h', '--', 'x\n[FATAL] [1.0] [safety_node]: EMERGENCY STOP')


def test_a_path_may_look_like_an_option_or_like_a_line_of_the_log(
    graph: Graph, node: Identifier, bag: Path, tmp_path: Path
) -> None:
    """`-h` as a bag had the fit print its help, and the node fail over the report that was not there."""
    start = f'import os; os.chdir({str(tmp_path)!r})'
    with identifier(graph, tmp_path, start) as other:
        for name in ODD_NAMES:
            shutil.copytree(bag, tmp_path / name)
            other.set(bags=[name], output_dir=f'outputs/{name}')
            other.identify()
            other.status('done.')
        heard = other.process.stderr
    assert (tmp_path / 'outputs' / ODD_NAMES[-1] / 'report.json').exists()
    assert not any(line.startswith('[FATAL]') for line in heard.splitlines())


TAMPERED = """
import os, shutil
from cfd_pneumatic.nodes.fit_process import FitProcess
failure = FitProcess.failure

def tampered(fit):
    told, report, kind = failure(fit), {report!r}, {kind!r}
    os.unlink(report)
    if kind == 'pipe':
        os.mkfifo(report)
    elif kind == 'folder':
        os.mkdir(report)
    elif kind != 'gone':
        open(report, 'w').write(kind)
    return told

FitProcess.failure = tampered
"""
"""Does to results what somebody else may do between the end of the fit and the node's look at them."""


@pytest.mark.parametrize(
    ('name', 'kind'),
    [
        *(('report.json', kind) for kind in ('gone', 'pipe', f'{{"password": "{SECRET}", "cylinders": {{}}}}')),
        *(('parameters.yaml', kind) for kind in ('folder', SECRET)),
    ],
)
def test_only_the_fit_s_own_results_are_published_and_set(
    graph: Graph, bag: Path, tmp_path: Path, name: str, kind: str
) -> None:
    output = tmp_path / 'out'
    tampered = TAMPERED.format(report=str(output / name), kind=kind)
    with identifier(graph, bag.parent, tampered, output_folder=tmp_path) as node:
        heard = graph.listen(String, f'{node.name}/result', LATCHED)
        node.set(bags=[str(bag)], output_dir=str(output))
        node.identify()
        status = graph.next_diagnostics(node.name, lambda one: one.level == DiagnosticStatus.ERROR)
        assert str(output / name) in status.message
        assert SECRET not in status.message + node.process.stderr
    assert heard == []


def test_cancel_ends_the_fit_at_once_and_leaves_earlier_outputs(
    graph: Graph, node: Identifier, bag: Path, tmp_path: Path
) -> None:
    with earlier_results(tmp_path / 'out') as output:
        node.set(bags=[str(bag)] * 30, output_dir=str(output))
        for percent in (0.0, 20.0):  # while it starts, and in its midst
            node.identify()
            node.progress(percent)
            assert graph.trigger(f'{node.name}/cancel').success
            assert node.status('cancelled').level == DiagnosticStatus.WARN


def test_an_interrupt_ends_node_and_fit(node: Identifier, bag: Path, tmp_path: Path) -> None:
    with earlier_results(tmp_path / 'out') as output:
        node.set(bags=[str(bag)] * 30, output_dir=str(output))
        node.identify()
        node.progress(0.0)
        (fit,) = children(node.process.pid)
        node.process.stop(signal.SIGINT)  # the last that the file's tests want of it
        assert not Path(f'/proc/{fit}').exists()


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    return [
        int(child) for task in Path(f'/proc/{pid}/task').iterdir() for child in (task / 'children').read_text().split()
    ]
