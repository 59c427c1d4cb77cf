"""The offline programs' help, and its examples, one after the other in an empty folder."""

from __future__ import annotations

import importlib

import pytest

from cfd_pneumatic import __version__
from cfd_pneumatic.examples import EXAMPLES
from cfd_pneumatic.start import HELP

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
    assert '(default: ' in ' '.join(said.split())
    assert '[Pa]' in said


@pytest.mark.parametrize('name', COMMANDS)
def test_it_says_its_version(name, capsys):
    with pytest.raises(SystemExit, match=r'^0$'):
        importlib.import_module(f'cfd_pneumatic.commands.{name}').main(['--version'])
    assert capsys.readouterr().out == f'{name} {__version__}\n'


def test_the_examples_work(examples):
    assert list(examples.said) == COMMANDS
    assert 'cylinder_a: Effect found. The model lacks leakage' in examples.said['identify_bag']
    assert 'cylinder_a pressure 3' in examples.said['csv_to_bag']
