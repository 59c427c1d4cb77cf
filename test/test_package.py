# SPDX-License-Identifier: Apache-2.0
"""What stands in more than one file about the package says the same everywhere."""

from __future__ import annotations

import ast
import csv
import importlib
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import cfd_pneumatic
from cfd_pneumatic.runtime import start
from studies.documents.package_facts import programs, setup_arguments

ROOT = Path(__file__).parents[1]

KEYS = {
    'jinja2': ('Jinja2', 'python3-jinja2'),
    'lz4': ('lz4', 'mcap-ros2-support'),
    'mcap': ('mcap', 'mcap-ros2-support'),
    'numba': ('numba', 'python3-numba'),
    'numpy': ('numpy', 'python3-numpy'),
    'psutil': ('psutil', 'python3-psutil'),
    'rich': ('rich', 'python3-rich'),
    'rosbags': ('rosbags', 'python3-rosbags-pip'),
    'scipy': ('scipy', 'python3-scipy'),
    'yaml': ('PyYAML', 'python3-yaml'),
    'zstandard': ('zstandard', 'mcap-ros2-support'),
}
"""For each module that is not ROS's: its name on PyPI, and the rosdep key that brings it."""

OPTIONAL = {'plant': {'dask', 'distributed', 'pyarrow'}, 'plot': {'matplotlib'}}
"""What only those need who want it: modules, named as on PyPI, by the extra that brings them."""

USERS = {'plant': {'plant'}, 'plot': {'path', 'reporting'}}
"""The layers that import what an extra brings."""


SETUP = setup_arguments()
XML = ElementTree.parse(ROOT / 'package.xml').getroot()
CHANGES = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
PROGRAMS = dict(re.split(r' = ', line) for line in SETUP['entry_points']['console_scripts'])


def xml_text(tag: str) -> str:
    element = XML.find(tag)
    assert element is not None, f'package.xml has no <{tag}>'
    return element.text or ''


def imported(folder: str) -> set[str]:
    """Return the top names of the modules from elsewhere that the Python files below a folder import when they run."""
    names = set()
    for path in (ROOT / folder).rglob('*.py'):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        for node in ast.walk(tree):
            if isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING':
                node.body = []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.split('.')[0])
    return names - sys.stdlib_module_names - {'cfd_pneumatic'}


LICENCE = 'SPDX-License-Identifier: Apache-2.0'
SOURCES = ('*.py', '*.sh', '*.css', '*.jinja', 'Makefile', '.ci/run')


def test_every_source_file_names_its_licence():
    listed = subprocess.run(['git', 'ls-files', '-z', *SOURCES], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip('not a clone of the repository')
    files = [ROOT / name for name in listed.stdout.split('\0') if name and (ROOT / name).exists()]
    assert len(files) > 400
    without = [path.name for path in files if LICENCE not in path.read_text(encoding='utf-8')[:1000]]
    assert without == [], f'add this line at the top: {LICENCE}'


def test_setup_reads_the_version_from_package_xml():
    command = [sys.executable, 'setup.py', '--version']
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout.split()[-1] == xml_text('version')


def test_version_and_citation_agree_with_package_xml():
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert cfd_pneumatic.__version__ == citation['version'] == xml_text('version')
    release = re.search(rf'^{re.escape(citation["version"])} \((\d{{4}}-\d\d-\d\d)\)$', CHANGES, re.MULTILINE)
    assert release is None or release[1] == citation['date-released'].isoformat()


def test_the_changelog_begins_with_the_current_version():
    headings = re.findall(r'^(.+)\n-+$', CHANGES, re.MULTILINE)
    if headings[0] == 'Forthcoming':
        headings = headings[1:]
    assert headings == [] or headings[0].split()[0] == cfd_pneumatic.__version__


def test_descriptions_agree():
    for argument in ('description', 'license', 'maintainer', 'author'):
        assert SETUP[argument] == xml_text(argument)
    assert SETUP['maintainer_email'] == XML.find('maintainer').get('email')


def test_colcon_takes_package_xml_for_a_ros_package():
    # A malformed maintainer's address alone makes it none, and colcon then builds without the ament hooks.
    reader = pytest.importorskip('catkin_pkg.package', reason='catkin_pkg, with which colcon reads it, is not here')
    warnings: list[str] = []
    package = reader.parse_package(str(ROOT / 'package.xml'), warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert (package.package_format, package.get_build_type()) == (3, 'ament_python')


ROSDEP_KEYS = Path(__file__).with_name('rosdep_keys.csv')
"""
Where rosdep finds each key of package.xml: `ros` (a package of the distribution), `apt`, `pip` or `none`.

A cell is `apt` if the key's rule in github.com/ros/rosdistro names an apt package and packages.ubuntu.com lists it for
the distribution's Ubuntu: 22.04 (Humble), 24.04 (Jazzy), 26.04 (Lyrical). `looked_up` is the date of both.
"""

DISTRIBUTIONS = ('humble', 'jazzy', 'lyrical')


def rosdep_table() -> list[dict[str, str]]:
    with ROSDEP_KEYS.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def is_date(text: str) -> bool:
    try:
        date.fromisoformat(text)
    except ValueError:
        return False
    return True


def rosdep_faults(keys: Iterable[str], table: Iterable[Mapping[str, str]]) -> list[str]:
    """Return what the table lacks of these keys, or has wrong."""
    rows = {row['key']: row for row in table}
    return [
        *(f'{key}: look it up for {ROSDEP_KEYS.name}' for key in sorted(set(keys) - set(rows))),
        *(f'{key}: package.xml does not have it' for key in sorted(set(rows) - set(keys))),
        *(f'{key}: no date of the look-up' for key, row in rows.items() if not is_date(row['looked_up'])),
        *(
            f'{key}: {row[distribution]!r} for {distribution}'
            for key, row in rows.items()
            for distribution in DISTRIBUTIONS
            if row[distribution] not in {'ros', 'apt', 'pip', 'none'}
        ),
    ]


def test_every_rosdep_key_was_looked_up():
    keys = {element.text for element in XML if element.tag.endswith('depend')}
    assert rosdep_faults(keys, rosdep_table()) == []


def test_a_rosdep_key_that_nobody_looked_up_is_found():
    row = {'humble': 'apt', 'jazzy': 'apt', 'lyrical': 'apt', 'looked_up': '2026-08-22'}
    table = [
        row | {'key': 'a'},
        row | {'key': 'b', 'looked_up': ''},
        row | {'key': 'c', 'jazzy': ''},
        row | {'key': 'd'},
    ]
    assert rosdep_faults({'a', 'b', 'c', 'e'}, table) == [
        'e: look it up for rosdep_keys.csv',
        'd: package.xml does not have it',
        'b: no date of the look-up',
        "c: '' for jazzy",
    ]


@pytest.mark.parametrize('distribution', DISTRIBUTIONS)
def test_rosdep_installs_what_package_xml_wants_of_a_distribution(distribution):
    """As rosdep does, by the conditions in package.xml."""
    reader = pytest.importorskip('catkin_pkg.package', reason='catkin_pkg, which reads conditions, is not here')
    package = reader.parse_package(str(ROOT / 'package.xml'))
    package.evaluate_conditions({'ROS_DISTRO': distribution})
    wanted = {one.name for one in (*package.build_depends, *package.test_depends) if one.evaluated_condition}
    found = {row['key'] for row in rosdep_table() if row[distribution] != 'none'}
    assert wanted == found


def test_the_readme_installs_with_pip_what_apt_does_not_have():
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    (skipped,) = re.findall(r"--skip-keys '([^']+)'", text)
    assert set(skipped.split()) == {row['key'] for row in rosdep_table() if row['jazzy'] == 'pip'}
    (installed,) = re.findall(r"^    pip install ('.*<.*')$", text, re.MULTILINE)
    wanted = re.findall("'([^']+)'", installed)
    assert set(wanted) <= set(SETUP['install_requires'])
    brought = {KEYS[re.match(r'[a-z]+', one)[0]][1] for one in wanted}
    assert brought == {row['key'] for row in rosdep_table() if row['jazzy'] in {'pip', 'none'}}


def test_what_is_imported_is_required_and_nothing_else():
    required = {re.match(r'[\w.-]+', line).group() for line in SETUP['install_requires']}
    keys = {element.text for element in XML.findall('depend')}
    used = imported('cfd_pneumatic') - set().union(*OPTIONAL.values())
    assert required == {KEYS[name][0] for name in used & set(KEYS)}
    # What is not in KEYS is ROS's, and has the same name as its package.
    assert keys == {KEYS[name][1] if name in KEYS else name for name in used}


@pytest.mark.parametrize('extra', OPTIONAL)
def test_an_extra_brings_what_its_layer_alone_imports(extra):
    brought = {re.match(r'[\w.-]+', line).group() for line in SETUP['extras_require'][extra]}
    assert brought - {'cryptography'} == OPTIONAL[extra]  # with which Dask makes certificates
    assert all(OPTIONAL[extra] <= imported(f'cfd_pneumatic/{layer}') for layer in USERS[extra])
    others = {path.name for path in (ROOT / 'cfd_pneumatic').iterdir() if path.is_dir()} - USERS[extra]
    assert [name for name in others if imported(f'cfd_pneumatic/{name}') & OPTIONAL[extra]] == []


def test_what_ci_installs_is_locked_and_its_licences_are_listed():
    heading, *lines = (ROOT / 'requirements' / 'ci.txt').read_text(encoding='utf-8').splitlines()
    assert 'Python 3.11 on Linux' in heading
    parts = [re.fullmatch(r'([\w.-]+)==([\w.]+) --hash=sha256:[0-9a-f]{64}', line) for line in lines]
    locked = {canonicalize_name(part[1]): part[2] for part in parts}  # whatever else stands in a line has no part
    for extra in ('jazzy', 'plant', 'test', 'lint', 'colcon', 'docs'):
        for wanted in map(Requirement, SETUP['install_requires'] + SETUP['extras_require'][extra]):
            assert locked[canonicalize_name(wanted.name)] in wanted.specifier, f'{wanted}: make lock'
    page = (ROOT / 'docs' / 'reference' / 'licences.md').read_text(encoding='utf-8')
    listed = re.findall(r'^\| .* \| (.*) \|$', page, re.MULTILINE)
    assert set(locked) <= {name for line in listed for name in line.split(', ')}, 'make licences'


def test_what_launch_files_import_is_required():
    assert imported('launch') <= {element.text for element in XML.findall('exec_depend') + XML.findall('depend')}


@pytest.mark.parametrize('name', PROGRAMS)
def test_program_is_there(name):
    assert PROGRAMS[name] == f'cfd_pneumatic.runtime.start:{name}'
    module = programs()[name]
    if '.nodes.' in module:
        pytest.importorskip('rclpy', reason='ROS 2 is not to be had here')
    assert module.split('.')[-1] == name
    assert callable(importlib.import_module(module).main)


BEGIN = """
import sys
before = set(sys.modules)
from cfd_pneumatic.runtime.start import {name}
code = {name}()
more = {{module.partition('.')[0] for module in set(sys.modules) - before}}
print(code, *more - sys.stdlib_module_names, file=sys.stderr)
"""


@pytest.mark.parametrize('name', PROGRAMS)
@pytest.mark.parametrize('asked', ['-h', '--help', '--version'])
def test_help_and_version_import_nothing_from_elsewhere(name, asked):
    command = [sys.executable, '-c', BEGIN.format(name=name), asked]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    page = (ROOT / 'cfd_pneumatic' / 'help' / f'{name}.txt').read_text(encoding='utf-8')
    assert ran.stdout == (f'{name} {cfd_pneumatic.__version__}\n' if asked == '--version' else page)
    assert ran.stderr.split() == ['0', 'cfd_pneumatic']


@pytest.mark.parametrize('name', ['record_rig', 'sim_node'])
def test_where_nothing_can_run_is_one_line(tmp_path, name):
    command = [sys.executable, '-c', f'import sys; from cfd_pneumatic.runtime.start import {name}; sys.exit({name}())']
    gone = ['sh', '-c', 'mkdir gone && cd gone && rmdir ../gone && exec "$@"', 'sh', *command]
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    trap = ['sh', '-c', 'echo "S: [x" > .numba_config.yaml && exec "$@"', 'sh', *command]
    pipe = ['sh', '-c', 'rm .numba_config.yaml; mkfifo DEFAULT_FASTRTPS_PROFILES.xml && exec "$@"', 'sh', *command]
    for given, more, word in (
        (gone, {}, 'does not exist any more'),
        (command, {'NUMBA_DISABLE_JIT': '1'}, 'NUMBA_DISABLE_JIT is set'),
        (trap, {}, 'holds .numba_config.yaml'),
        (pipe, {}, 'DEFAULT_FASTRTPS_PROFILES.xml in the working folder'),
    ):
        ran = subprocess.run(given, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment | more)
        assert (ran.returncode, ran.stderr.count('\n')) == (2, 1)
        assert word in ran.stderr


@pytest.mark.parametrize('option', ['-h', '--help', '--version'])
def test_behind_two_dashes_a_bag_may_be_called_like_an_option(tmp_path, monkeypatch, capsys, option):
    monkeypatch.chdir(tmp_path)
    assert not start.print_help_or_version('identify_bag', ['--output', 'out', '--', option])
    assert start.print_help_or_version('identify_bag', ['--output', 'out', option, '--', 'bag'])
