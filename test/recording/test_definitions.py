# SPDX-License-Identifier: Apache-2.0
"""Definitions of messages that a stranger wrote: short texts that would be read for hours, and folders without end."""

from __future__ import annotations

import os

import pytest
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import definitions
from cfd_pneumatic.messages.definitions import Definitions

pytestmark = [pytest.mark.timeout(60), pytest.mark.usefixtures('impatient')]

MSG, IDL = MessageDefinitionFormat.MSG, MessageDefinitionFormat.IDL
SEPARATOR = '=' * 80 + '\n'
PART = f'{SEPARATOR}MSG: a/C\nint32 x\n'
MODULE = 'module a { module msg { %s struct B { double x; }; }; };'
STRUCT = 'module a { module msg { struct B { %s }; }; };'


@pytest.fixture
def impatient(monkeypatch):
    """Let definitions have a tenth of the size and of the steps, which takes a tenth of the time."""
    monkeypatch.setattr(definitions, 'MOST_STEPS', definitions.MOST_STEPS // 10)
    monkeypatch.setattr(definitions, 'LARGEST', definitions.LARGEST // 10)
    monkeypatch.setattr(definitions, 'LONGEST_PARSING', definitions.LONGEST_PARSING / 10.0)


def defined(text, kind=MSG):
    """Return the fields of `a/msg/B`, which a bag defines by a text."""
    connection = Connection(1, '/x', 'a/msg/B', MessageDefinition(kind, text), '', 1, None, None)
    return Definitions().for_topic([connection]).fielddefs['a/msg/B'][1]


def test_a_definition_of_thousands_of_fields_is_read():
    assert len(defined('\n'.join(f'float64 x{index}' for index in range(1_000)))) == 1_000


@pytest.mark.parametrize('before', ['\n' * 2_000, '# why\n' * 500, PART * 300 + SEPARATOR + 'MSG: a/B\n'])
def test_what_is_long_but_soon_read_is_read(before):
    assert [name for name, _ in defined(before + 'float64 x')] == ['x']


NOT_READ = {
    'fields': '\n'.join(f'float64 x{index}' for index in range(6_000)),
    'a default of a million numbers': 'int32[] x [' + '1,' * 50_000 + '1]',
    'a word': 'a' * 100_000 + ' x',
    'slashes': 'a/' * 40_000 + 'B x',
    'a number': 'int32 A=' + '1' * 100_000,
    'strings that do not end': 'string x "\n' * 9_000,
    'more than may be': '#' * 2**17 + '\nfloat64 x',
}
NOT_READ_IDL = {
    'parentheses': 'module a { const int32 A = ' + '(' * 200 + '1' + ')' * 200 + '; };',
    'a shift': 'module a { const int32 A = 1 << 10000000000; };' + STRUCT % 'double x;',
    'sequences': STRUCT % ('sequence<' * 40 + 'double' + '>' * 40 + ' x;'),
    'sequences before a comment': STRUCT % ('sequence<' * 15 + '/*' + 'x' * 90_000),
    'modules': 'module a {' * 5_000,
    'constants': MODULE % '\n'.join(f'const int32 A{index} = {index};' for index in range(5_000)),
    'a comment that does not end': '/*' + '*' * 50_000,
    'a name in a name': STRUCT % ('a::' * 20_000 + 'b x;'),
    'annotations': STRUCT % ('@a ' * 10_000 + 'double x;'),
    'types that are each other': 'module a { module msg { typedef u t; typedef t u; struct B { t x; }; }; };',
}


@pytest.mark.parametrize(
    ('text', 'kind'),
    [pytest.param(text, MSG, id=name) for name, text in NOT_READ.items()]
    + [pytest.param(text, IDL, id=f'{name} in IDL') for name, text in NOT_READ_IDL.items()],
)
def test_what_would_be_read_for_long_is_refused(text, kind):
    with pytest.raises(InputError, match='a/msg/B'):
        defined(text, kind)


def test_all_definitions_of_a_bag_share_what_may_be_read():
    shared = Definitions()
    text = '\n'.join(f'float64 x{index}' for index in range(900))

    def define(*names):
        for name in names:
            shared.for_topic([Connection(1, '/x', name, MessageDefinition(MSG, text), '', 1, None, None)])

    define('a/msg/B')
    with pytest.raises(InputError, match='takes too long to parse'):
        define(*(f'a/msg/B{number}' for number in range(10)))


# folders of definitions


def test_a_folder_has_a_bound_on_its_entries(tmp_path, monkeypatch):
    monkeypatch.setattr(definitions, 'MOST_ENTRIES', 20)
    for index in range(21):
        (tmp_path / f'{index}.txt').touch()
    with pytest.raises(InputError, match='holds more than 20 files and folders'):
        Definitions(tmp_path)


@pytest.mark.parametrize(('count', 'size'), [(11, 10), (3, 60)])
def test_a_folder_has_a_bound_on_its_definitions(tmp_path, monkeypatch, count, size):
    monkeypatch.setattr(definitions, 'MOST_FILES', 10)
    monkeypatch.setattr(definitions, 'LARGEST_TOGETHER', 150)
    for index in range(count):
        (tmp_path / f'A{index}.msg').write_text('#' * size)
    with pytest.raises(InputError, match=r'holds more than 10 \.msg files or'):
        Definitions(tmp_path)


def test_a_definition_has_a_bound(tmp_path):
    (tmp_path / 'A.msg').touch()
    os.truncate(tmp_path / 'A.msg', 2**20 // 10 + 1)
    with pytest.raises(InputError, match='has more than'):
        Definitions(tmp_path)


def test_links_and_hidden_folders_are_not_followed(tmp_path):
    (tmp_path / 'elsewhere' / 'msg').mkdir(parents=True)
    (tmp_path / 'elsewhere' / 'msg' / 'A.msg').write_text('float64 x')
    package = tmp_path / 'package'
    package.mkdir()
    (package / 'loop').symlink_to(package)
    (package / 'msg').symlink_to(tmp_path / 'elsewhere' / 'msg')
    (package / '.hidden').mkdir()
    (package / '.hidden' / 'B.msg').write_text('float64 x')
    with pytest.raises(InputError, match=r'holds no \.msg files'):
        Definitions(package)


def test_of_a_file_only_the_type_in_its_name_counts(tmp_path):
    """Further parts, which .msg files have in bags only, are neither read nor named."""
    file = tmp_path / 'a' / 'msg' / 'B.msg'
    file.parent.mkdir(parents=True)
    file.write_text(f'float64 x\n{SEPARATOR}MSG: a/Secret\nfloat64 y\nfloat64 y\n')
    undefined = MessageDefinition(MessageDefinitionFormat.NONE, '')
    types = Definitions(tmp_path).for_topic([Connection(1, '/x', 'a/msg/B', undefined, '', 1, None, None)])
    assert [name for name, _ in types.fielddefs['a/msg/B'][1]] == ['x']
    assert 'a/msg/Secret' not in types.fielddefs
