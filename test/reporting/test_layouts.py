# SPDX-License-Identifier: Apache-2.0
"""The layouts in config/ are of today's topics: those that compare.mcap has, and the fields of their messages."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree

import pytest
from identified import closed, with_force
from rosbags.highlevel import AnyReader

from cfd_pneumatic.messages.types import standard_types
from cfd_pneumatic.reporting import write_report
from studies.documents.layouts import CELL, FOLDER, LAYOUTS, layouts


def curves_of(name):
    """Return the curves of both programs' layouts as written there."""
    juggled = ElementTree.parse(FOLDER / f'{name}.plotjuggler.xml')
    foxed = json.loads((FOLDER / f'{name}.foxglove.json').read_text(encoding='utf-8'))
    return (
        [curve.get('name') for curve in juggled.iter('curve')],
        [path['value'] for panel in foxed['configById'].values() for path in panel.get('paths', ())],
    )


@pytest.fixture(scope='module')
def messages(tmp_path_factory):
    """Return the last message of each topic of a compare.mcap."""
    folder = tmp_path_factory.mktemp('compared')
    write_report(with_force(closed()), folder)
    with AnyReader([folder / 'compare.mcap'], default_typestore=standard_types()) as reader:
        return {
            connection.topic: reader.deserialize(payload, connection.msgtype)
            for connection, _, payload in reader.messages()
        }


def number_at(message, path):
    """Return what Foxglove finds in a message: names with dots in between, list elements in brackets."""
    for name in re.findall(r'\w+', path):
        message = message[int(name)] if name.isdigit() else getattr(message, name)
    return message


def test_layouts_are_up_to_date():
    assert {path: path.read_text(encoding='utf-8') for path in layouts()} == layouts()


def test_what_foxglove_shows_is_in_compare_mcap(messages):
    _, paths = curves_of('compare')
    shown = dict(path.split('.', 1) for path in paths)
    assert shown.keys() == messages.keys()
    assert all(isinstance(float(number_at(messages[topic], path)), float) for topic, path in shown.items())


def test_what_plotjuggler_shows_is_in_compare_mcap(messages):
    curves, _ = curves_of('compare')
    left = set(messages)
    for curve in curves:
        topic = max((topic for topic in messages if curve.startswith(f'{topic}/')), key=len)
        message, field = messages[topic], curve.removeprefix(f'{topic}/').replace('/', '.')
        if hasattr(message, 'position'):  # PlotJuggler has joints by their names
            name, field = field.split('.')
            field = f'{field}[{message.name.index(name)}]'
        float(number_at(message, field))
        left.discard(topic)
    assert left == set()


@pytest.mark.parametrize('name', LAYOUTS)
def test_both_programs_show_the_same(name):
    curves, paths = curves_of(name)
    assert [curve.rsplit('/piston_state/', 1)[0] for curve in sorted(set(curves))] == [
        path.replace('.', '/').rsplit('/piston_state/', 1)[0] for path in sorted(set(paths))
    ]


@pytest.mark.parametrize('name', LAYOUTS)
def test_every_panel_of_foxglove_has_its_place(name):
    layout = json.loads((FOLDER / f'{name}.foxglove.json').read_text(encoding='utf-8'))

    def placed(node):
        if isinstance(node, str):
            return {node}.union(*(placed(tab['layout']) for tab in layout['configById'][node].get('tabs', ())))
        return placed(node['first']) | placed(node['second'])

    assert placed(layout['layout']) == set(layout['configById'])


def test_a_cell_of_another_name_is_one_replacement_away():
    for name in ('cell.plotjuggler.xml', 'cell.foxglove.json'):
        text = (FOLDER / name).read_text(encoding='utf-8').replace(f'"{CELL}/', '"/cell_7/')
        assert re.findall(r'"(/\w+)/', text) == ['/cell_7'] * text.count('"/')
