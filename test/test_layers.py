# SPDX-License-Identifier: Apache-2.0
"""Imports point downwards only, as docs/design.md draws the layers."""

from __future__ import annotations

import ast
import re
import sys
from functools import cache
from importlib import import_module
from itertools import chain, takewhile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'cfd_pneumatic'

BELOW = {
    'api': {'path', 'planning', 'reporting', 'device', 'identification', 'recording', 'messages', 'model'},
    'nodes': {
        'commands',
        'monitoring',
        'path',
        'planning',
        'plant',
        'reporting',
        'device',
        'identification',
        'recording',
        'messages',
        'model',
        'rig',
    },
    'commands': {
        'monitoring',
        'path',
        'planning',
        'plant',
        'reporting',
        'device',
        'identification',
        'recording',
        'messages',
        'model',
        'rig',
    },
    'path': {'charts', 'reporting', 'device', 'identification', 'recording', 'messages', 'model'},
    'planning': {'charts', 'reporting', 'device', 'identification', 'recording', 'messages', 'model'},
    'plant': {'charts', 'reporting', 'device', 'identification', 'recording', 'messages', 'model'},
    'monitoring': {'reporting', 'device', 'identification', 'recording', 'messages', 'model'},
    'reporting': {'charts', 'device', 'identification', 'recording', 'messages', 'model'},
    'device': {'identification', 'recording', 'messages', 'model'},
    'identification': {'recording', 'messages', 'model'},
    'recording': {'messages'},
    'charts': set(),
    'generator': {'model'},
    'model': set(),
    'messages': set(),
    'rig': set(),
}
"""What each layer may import, besides itself, `GROUND` and the single modules at the top of the package."""

FOR_USERS = {'device/device.py': {'path'}}
"""Modules with methods that lead to a layer above, which they load when they are called."""

GROUND = ('files', 'runtime')
"""Packages that all layers may import; they import the single modules at the top, and the second one the first."""

ROOMS = ('data', 'residual', 'channels', 'fit', 'search')
"""Of `identification`, each of which may import those before it; the modules beside them import all."""

ROS = re.compile(r'(rclpy|rcl_interfaces|ament_\w+|builtin_interfaces|launch\w*|rosidl\w*|ros2\w*|\w+_(msgs|srvs))$')
INPUT_OUTPUT = {'csv', 'io', 'json', 'logging', 'os', 'pathlib', 'shutil', 'socket', 'sqlite3', 'subprocess', 'sys'}


def imports(path: Path) -> set[str]:
    """Return the full dotted names that a module imports, at its top and inside of functions."""
    # A package's own relative imports start from itself, a module's from the package that it is in.
    home = ['cfd_pneumatic', *path.relative_to(PACKAGE).parent.parts]
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = home[: len(home) + 1 - node.level] if node.level else []
            module = '.'.join([*start, *([node.module] if node.module else [])])
            # `from cfd_pneumatic import rig` imports a layer, too.
            names |= {f'{module}.{alias.name}' for alias in node.names}
    return names


def layer_of(name: str) -> str:
    """Return the layer of a module of ours, or '' for one at the top."""
    part = name.split('.')[1]
    return part if part in BELOW or part in GROUND else ''


MODULES = sorted(PACKAGE.rglob('*.py'))


def in_layer(*layers: str) -> list[Path]:
    return [path for path in MODULES if path.relative_to(PACKAGE).parts[0] in layers]


def outside(path: Path) -> set[str]:
    """Return the top names of what a module imports from elsewhere."""
    return {name.split('.')[0] for name in imports(path)} - {'cfd_pneumatic'}


def test_every_layer_is_known_and_a_package():
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != '__pycache__'}
    assert folders - {'help', *GROUND} == set(BELOW)
    assert [layer for layer in BELOW if not (PACKAGE / layer / '__init__.py').is_file()] == []


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_downwards(path):
    own = path.relative_to(PACKAGE).parts[0]
    if own in GROUND:
        allowed = {'', *GROUND[: GROUND.index(own) + 1]}
    elif own in BELOW:
        allowed = {'', own, *GROUND, *BELOW[own], *FOR_USERS.get(str(path.relative_to(PACKAGE)), ())}
    else:
        allowed = {'', *(BELOW if own == '__init__.py' else ())}
    ours = {name for name in imports(path) if name.startswith('cfd_pneumatic.')}
    assert {name for name in ours if layer_of(name) not in allowed} == set()


@pytest.mark.parametrize('path', in_layer('identification'), ids=lambda path: path.name)
def test_the_rooms_of_identification_point_one_way(path):
    here = path.relative_to(PACKAGE / 'identification').parts[0]
    allowed = {'', *ROOMS[: ROOMS.index(here) + 1]} if here in ROOMS else {'', *ROOMS}
    parts = {name.split('.')[2] for name in imports(path) if name.startswith('cfd_pneumatic.identification.')}
    modules_beside = parts - set(ROOMS)
    assert parts & set(ROOMS) <= allowed
    assert not (modules_beside and here in ROOMS)


INSIDE = ('generator', 'model/composed.py')
"""Writes the kernel of the effects' modules, and what it writes: they know the inside of the model."""

IMPORTING = [
    *MODULES,
    *sorted(path for room in ('studies', 'scripts', 'benchmark') for path in ROOT.joinpath(room).rglob('*.py')),
]


def module_name(path: Path) -> list[str]:
    """Return the parts of a module's full name."""
    parts = list(path.relative_to(ROOT).with_suffix('').parts)
    return parts[:-1] if parts[-1] == '__init__' else parts


def imported_modules(path: Path) -> set[str]:
    """Return the full names of our modules and packages that a module imports from."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split('.')[0] == PACKAGE.name:
            for alias in node.names:
                submodule = ROOT.joinpath(*node.module.split('.'), alias.name)
                is_module = submodule.with_suffix('.py').is_file() or submodule.is_dir()
                is_exported = alias.name in exported_by(node.module)
                found.add(f'{node.module}.{alias.name}' if is_module and not is_exported else node.module)
    return found


@cache
def exported_by(package: str) -> tuple[str, ...]:
    """Return what a package imports of its own modules, and defines; nothing for a module."""
    face = ROOT.joinpath(*package.split('.'), '__init__.py')
    if not face.is_file():
        return ()
    names = []
    body = ast.parse(face.read_text(encoding='utf-8')).body
    for node in [*body, *chain.from_iterable(node.body for node in body if isinstance(node, ast.If))]:
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(f'{package}.'):
            names += [alias.asname or alias.name for alias in node.names]
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.append(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names += [target.id for target in targets if isinstance(target, ast.Name)]
    return tuple(name for name in names if not name.startswith('_'))


@pytest.mark.parametrize(
    'path',
    [
        path
        for path in IMPORTING
        if not str(path.relative_to(ROOT)).startswith(tuple(f'{PACKAGE.name}/{one}' for one in INSIDE))
    ],
    ids=lambda path: '/'.join(module_name(path)),
)
def test_other_packages_are_entered_by_their_doors(path):
    """An import reaches at most one level below the deepest package that it has in common with its module."""
    own = module_name(path) if path.name == '__init__.py' else module_name(path)[:-1]
    own = own if own[0] == PACKAGE.name else [PACKAGE.name]  # studies stand before the doors of the library
    for name in imported_modules(path):
        parts = name.split('.')
        common = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(own, parts)))
        assert len(parts) - common <= 1, name


def test_no_modules_import_each_other():
    """Without packages' faces, which load what they export when it is asked for."""
    graph = {'.'.join(module_name(path)): imported_modules(path) for path in MODULES if path.name != '__init__.py'}
    remaining = {name: {one for one in names if one in graph} for name, names in graph.items()}
    while free := [name for name, names in remaining.items() if not names]:
        for name in free:
            del remaining[name]
        for names in remaining.values():
            names.difference_update(free)
    assert remaining == {}


@pytest.mark.parametrize('path', [path for path in MODULES if path.name == '__init__.py'], ids=str)
def test_a_door_opens_all_that_it_names(path):
    package = '.'.join(module_name(path))
    if package.endswith(('.nodes', '.plant')):
        pytest.importorskip('rclpy' if package.endswith('.nodes') else 'distributed')
    face = import_module(package)
    assert [name for name in exported_by(package) if isinstance(getattr(face, name), ModuleType)] == []


def test_only_the_nodes_import_ros():
    users = {str(path.relative_to(PACKAGE)) for path in MODULES if any(ROS.match(name) for name in outside(path))}
    assert {path for path in users if not path.startswith('nodes/')} == set()


def test_yaml_comes_in_by_one_door():
    users = {path.name for path in MODULES if outside(path) & {'yaml', 'ruamel'}}
    assert users == {'yaml_files.py'}


def test_processes_are_started_by_one_door():
    starting = re.compile(r'sys\.executable|\bPopen\(|subprocess\.run|os\.(exec|spawn|popen|system|fork)')
    assert {path.name for path in MODULES if starting.search(path.read_text(encoding='utf-8'))} == {'children.py'}


@pytest.mark.parametrize('path', in_layer('model'), ids=lambda path: path.name)
def test_the_model_is_numpy_and_numba_without_input_or_output(path):
    assert outside(path) & INPUT_OUTPUT == set()
    assert outside(path) - sys.stdlib_module_names <= {'numpy', 'numba'}


def test_this_test_sees_each_form_of_import(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), 'PACKAGE', tmp_path)
    module = tmp_path / 'rig' / 'module.py'
    module.parent.mkdir()
    module.write_text(
        'import numpy as np\n'
        'from cfd_pneumatic import model\n'
        'def late():\n'
        '    from ..recording.bags import bag\n'
        '    from . import physics\n'
        '    import cfd_pneumatic.nodes.sim_node\n'
    )
    assert imports(module) == {
        'numpy',
        'cfd_pneumatic.model',
        'cfd_pneumatic.recording.bags.bag',
        'cfd_pneumatic.rig.physics',
        'cfd_pneumatic.nodes.sim_node',
    }
