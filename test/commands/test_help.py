# SPDX-License-Identifier: Apache-2.0
"""The offline programs' help, and its examples, one after the other in an empty folder."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from cfd_pneumatic import __version__
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.examples import EXAMPLES
from cfd_pneumatic.runtime.start import HELP
from studies.documents.tutorial import run

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
def test_options_are_written_out(name):
    parser = importlib.import_module(f'cfd_pneumatic.commands.{name}').make_parser()
    arguments = [one.dest for one in parser._actions if not one.option_strings]
    for option in parser._option_string_actions:
        if option.startswith('--') and option[:-1] not in parser._option_string_actions:
            with pytest.raises(InputError, match=r'unrecognized arguments|are required'):
                parser.parse_args([*arguments, option[:-1], '1'])


REFUSED = """
import sys
from importlib import import_module
code = import_module('cfd_pneumatic.commands.{name}').main(['--no-such-option'])
print(code, *{{'matplotlib', 'numba', 'scipy'}} & set(sys.modules))
"""


@pytest.mark.parametrize('name', COMMANDS)
def test_a_wrong_option_is_refused_before_any_large_library_is_imported(name):
    command = [sys.executable, '-c', REFUSED.format(name=name)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() == ['2']


@pytest.mark.parametrize('name', COMMANDS)
def test_it_says_its_version(name, capsys):
    with pytest.raises(SystemExit, match=r'^0$'):
        importlib.import_module(f'cfd_pneumatic.commands.{name}').main(['--version'])
    assert capsys.readouterr().out == f'{name} {__version__}\n'


def test_once_compiled_nothing_is_compiled_again(compiled, examples):
    """What a first start would compile, whichever program it is of."""
    assert compiled.said['compile_kernels'] == f'compiled: the machine code is kept below {compiled.cache}\n'
    assert examples.said['compile_kernels'] == 'everything is compiled already\n'
    more = 'identify_bag rig_bag --per-setpoint --output rig_by_setpoint'
    run(more, examples.folder, examples.environment | {'NUMBA_CACHE_DIR': str(compiled.cache)})
    assert examples.machine_code == compiled.said['machine code'] != ''


def test_the_examples_work(examples):
    assert list(examples.said) == COMMANDS
    assert 'Leakage in cylinder A' in examples.said['identify_bag']
    assert 'cylinder_a pressure: 68.33 to 68.95 kPa gauge' in examples.said['csv_to_bag']
