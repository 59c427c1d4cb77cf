"""The offline programs' help, and its examples, one after the other in an empty folder."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path
from subprocess import PIPE

import pytest

from cfd_pneumatic import __version__
from cfd_pneumatic.examples import EXAMPLES
from cfd_pneumatic.start import HELP

ROOT = Path(__file__).parents[2]
COMPILE = 'from cfd_pneumatic.commands.compile_kernels import main; main([])'
RUN = """
import sys
from cfd_pneumatic.compiling import announced
from cfd_pneumatic.commands import identify_bag, plan_experiment, record_rig
from cfd_pneumatic import model, monitoring
with announced(lambda folder: print(f'compiled {folder}', file=sys.stderr), lambda: None):
    record_rig.main(['surface_following', '--duration', '15', '--output', 'bag_to_compile'])
    identify_bag.main(['bag_to_compile', '--close-loop', '--progress', 'none', '--output', 'compiled'])
    identify_bag.main(['bag_to_compile', '--per-setpoint', '--progress', 'none', '--output', 'compiled'])
    plan_experiment.main(['compiled/parameters.yaml', '--duration', '8', '--output', 'compiled'])
    model.warm_up()
    monitoring.warm_up()
"""
COMMANDS = [name for name in EXAMPLES if not name.endswith('_node')]


@pytest.mark.parametrize('name', COMMANDS)
def test_help_says_units_and_defaults_and_ends_with_the_example(name, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '100')  # as wide as the page
    main = importlib.import_module(f'cfd_pneumatic.commands.{name}').main
    with pytest.raises(SystemExit, match=r'^0$'):
        main(['--help'])
    said = capsys.readouterr().out
    assert said.endswith(EXAMPLES[name])
    page = (HELP / f'{name}.txt').read_text(encoding='utf-8')
    assert said.split() == page.split(), 'run make interface-document'
    if name not in ('compile_kernels', 'dask_certificate'):  # which have no options
        assert '(default: ' in ' '.join(said.split())
        assert '[Pa]' in said


@pytest.mark.parametrize('name', COMMANDS)
def test_it_says_its_version(name, capsys):
    with pytest.raises(SystemExit, match=r'^0$'):
        importlib.import_module(f'cfd_pneumatic.commands.{name}').main(['--version'])
    assert capsys.readouterr().out == f'{name} {__version__}\n'


def test_once_compiled_nothing_is_compiled_again(examples, tmp_path):
    """What a first start would compile, whichever program it is of."""
    folder, cache = examples.folder, {'NUMBA_CACHE_DIR': str(tmp_path), 'PYTHONPATH': str(ROOT)}
    environment = os.environ | cache

    def start(program):
        command = [sys.executable, '-c', program]
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=PIPE, stderr=PIPE, text=True)

    started = [start(COMPILE)]
    said = [started[0].communicate()]
    started += [start(COMPILE), start(RUN)]
    said += [one.communicate() for one in started[1:]]
    assert [one.returncode for one in started] == [0, 0, 0], said
    assert said[0][0] == f'compiled: the machine code is kept below {tmp_path}\n', said
    assert said[1][0] == 'everything is compiled already\n', said
    assert said[2][1] == ''


def test_the_examples_work(examples):
    assert list(examples.said) == COMMANDS
    assert 'cylinder_a: Effect found. The model lacks leakage' in examples.said['identify_bag']
    assert 'cylinder_a pressure: 68.33 to 68.95 kPa gauge' in examples.said['csv_to_bag']
