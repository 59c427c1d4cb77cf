# SPDX-License-Identifier: Apache-2.0
"""A ROS graph of its own for the tests, how property tests are run, and a word on those that can't run here."""

from __future__ import annotations

import fcntl
import gc
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

# As programs do, before NumPy is there: the threads of its library take more than twice the time on the same cores.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1]))  # studies/; last, so that an installed package comes first

import pytest
from hypothesis import HealthCheck, settings
from patience import allowed

from cfd_pneumatic.examples import EXAMPLES
from studies.documents.tutorial import blocks, programs, run
from studies.tools.chromium import PROGRAM, Chromium
from studies.tools.ros_environment import isolate

isolate()
for name in ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE'):  # as Lyrical and Humble call it
    os.environ[name] = str(Path(__file__).with_name('discovery.xml'))

# Where a script starts the tests in the background, an interrupt is ignored, and what they start inherits that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# How property tests are run: `make test` says the same every time, `make properties` looks for examples that nobody
# has seen.
# Without deadlines, for a busy machine takes its time. A test that is slow asks for a share of `max_examples`.
ANY_SPEED = {'deadline': None, 'suppress_health_check': [HealthCheck.too_slow]}
settings.register_profile('repeatable', derandomize=True, **ANY_SPEED)
settings.register_profile('random', derandomize=False, max_examples=200, print_blob=True, **ANY_SPEED)
settings.load_profile('repeatable')

NEEDS = {'nodes': ('ROS 2', ['rclpy']), 'plant': ('Dask', ['distributed', 'pyarrow'])}
"""Folders of tests that need what not everybody has: its name, and its modules."""

collect_ignore = []
left_out = []
for folder, (name, modules) in NEEDS.items():
    try:
        for module in modules:
            import_module(module)
    except ImportError as error:
        collect_ignore.append(folder)
        left_out.append(f'test/{folder} is left out: {name} is not to be had here ({error})')


LONG = (
    'nodes/test_sim_node.py',
    'plant/test_each.py',
    'identification/test_cores.py',
    'identification/test_alternative_readings.py',
    'identification/test_measured_loop.py',
    'test_mistakes.py',
    'identification/test_loop.py',
    'identification/test_force_loop.py',
    'test_adding_an_effect.py',
    'identification/test_shapes.py',
    'nodes/test_monitor_node.py',
    'nodes/test_closed_loop.py',
    'nodes/test_tutorial_live.py',
    'nodes/test_identifier_node.py',
    'nodes/test_program.py',
    'planning/test_against_the_rig.py',
    'test_tutorial.py',
    'plant/test_cluster.py',
    'rig/test_panel.py',
    'api/test_python.py',
    'test_files.py',
    'test_fuzzing.py',
)
"""
Files that take longest: where processes share the files, these come first, or one would work on alone in the end.

Not quite first are those of what is typed meanwhile.
"""


def pytest_configure(config):
    config.option.loadscopereorder = False  # by which xdist would begin with the files of the most tests


def pytest_collection_modifyitems(items):
    folder = Path(__file__).parent
    place = {folder / name: number for number, name in enumerate(LONG if 'PYTEST_XDIST_WORKER' in os.environ else ())}
    place[folder / 'commands' / 'test_help.py'] = len(LONG) + 1  # or all would wait for what is typed
    items.sort(key=lambda item: place.get(Path(item.fspath), len(LONG)))


def pytest_collection_finish():
    """Let no collection look for garbage among the modules and tests that stay: it takes longer than many a test."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Let the time limit of a test grow with the load of the machine."""
    if item.config.pluginmanager.hasplugin('timeout') and item.config.getoption('timeout') is None:
        item.add_marker(pytest.mark.timeout(allowed(float(item.config.getini('timeout')))))
    yield


@pytest.fixture(scope='module')
def browser():
    """Yield a headless Chromium."""
    if not PROGRAM:
        pytest.skip('no Chromium here: apt-get install chromium')
    with Chromium() as one:
        yield one


class Session(NamedTuple):
    """A reader's folder, what the commands below each heading said, and the environment that finds the programs."""

    folder: Path
    said: dict[str, str]
    environment: dict[str, str]

    @property
    def cache(self) -> Path:
        """Where all sessions keep machine code."""
        return self.folder.with_name('machine_code')

    @property
    def machine_code(self) -> str:
        """The names of what is compiled there."""
        return '\n'.join(sorted(path.name for path in self.cache.rglob('*.nb?')))


def once(
    factory: pytest.TempPathFactory, name: str, type_into: Callable[[Session], None], around: Mapping[str, str]
) -> Session:
    """Return a session that one worker of the tests types, while the others wait for it."""
    base = factory.getbasetemp()
    root = base.parent if 'PYTEST_XDIST_WORKER' in os.environ else base
    folder, kept = root / name, root / f'{name}.json'
    with (root / f'{name}.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            folder.mkdir()
            session = Session(folder, {}, programs(root / f'{name}_programs', around))
            session.environment['NUMBA_CACHE_DIR'] = str(session.cache)
            type_into(session)
            paths = {key: session.environment[key] for key in ('PATH', 'PYTHONPATH')}
            kept.write_text(json.dumps([session.said, paths]))
    said, paths = json.loads(kept.read_text())
    return Session(folder, said, {**around, **paths})  # with this worker's own ROS graph


def type_compiled(one: Session) -> None:
    """Compile all that sessions want of the model, once, where nothing is compiled yet."""
    one.said['compile_kernels'] = run('compile_kernels', one.folder, one.environment)
    one.said['machine code'] = one.machine_code


def type_examples(one: Session) -> None:
    """Type the examples of the offline programs' help."""
    for name, example in EXAMPLES.items():
        if not name.endswith('_node'):
            one.said[name] = run(example, one.folder, one.environment)


def type_tutorial(one: Session) -> None:
    """Type the tutorial's commands, but those that need measured data, which its last part alone does."""
    for block in blocks():
        if block.language == 'sh' and 'CFD_PNEUMATIC_DATA' not in block.text:
            one.said[block.heading] = one.said.get(block.heading, '') + run(block.text, one.folder, one.environment)


TYPED = {'compiled': type_compiled, 'examples': type_examples, 'tutorial': type_tutorial}
"""What is typed, one after the other, by the fixture that gives it."""


@pytest.fixture(scope='session', autouse=True)
def typed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Future]]:
    """Type what tests of this run want to see typed, beside the tests before them, which leave a core idle."""
    names = {name for item in request.session.items for name in item.fixturenames if name in TYPED}
    wanted = [name for name in TYPED if name in names or (names and name == 'compiled')]
    around = dict(os.environ)  # which tests change meanwhile
    tmp_path_factory.getbasetemp()  # is made once, by one thread
    with ThreadPoolExecutor(1) as pool:
        yield {name: pool.submit(once, tmp_path_factory, name, TYPED[name], around) for name in wanted}
        pool.shutdown(cancel_futures=True)


@pytest.fixture(scope='session')
def compiled(typed: dict[str, Future]) -> Session:
    """Return what the compiler of all kernels said, and the names of its machine code."""
    return typed['compiled'].result()


@pytest.fixture(scope='session')
def tutorial(typed: dict[str, Future]) -> Session:
    """Return what the tutorial's commands left and said."""
    return typed['tutorial'].result()


@pytest.fixture(scope='session')
def examples(typed: dict[str, Future]) -> Session:
    """Return what the examples left and said."""
    return typed['examples'].result()


def pytest_terminal_summary(terminalreporter):
    for line in left_out:
        terminalreporter.write_line(line, yellow=True)
