# SPDX-License-Identifier: Apache-2.0
"""A further measured channel: a class and a row of `CHANNELS`, and everything else knows of it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from drawn import both_cylinders
from rosbags.highlevel import AnyReader

from cfd_pneumatic.identification import Options, channels, identify
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.messages import types as messages
from cfd_pneumatic.recording import Signal, read_mapping, read_recording
from cfd_pneumatic.reporting import write_report
from studies.panel import draw

AREA = 1.14e-3
EPOCH = 1_700_000_000_000_000_000


class ToolForce(Force):
    """What a second load cell measures, at the tool: the same model as the contact force's."""

    name = 'tool_force'
    topics = 'measured_tool_force', 'tool_force'

    def signal(self, recording):
        return recording.others.get('tool_force')


@pytest.fixture(scope='module', autouse=True)
def tool_force_is_a_channel():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(channels, 'CHANNELS', [*channels.CHANNELS, ToolForce])
        yield


@pytest.fixture(scope='module')
def recording():
    """Return a device whose contact force is as it should be, while a constant 8 N weighs on the tool's cell."""
    drawn = both_cylinders(draw(None, 'paper_step', 4))
    rng = np.random.default_rng(7)
    weighed = drawn.force.values + 8.0 + 0.1 * rng.standard_normal(drawn.force.values.size)
    return replace(drawn, epoch=EPOCH, others={'tool_force': Signal(drawn.force.times, weighed)})


@pytest.fixture(scope='module')
def found(recording):
    return identify([recording], Options(close_loop=True, area=AREA, geometric_factor=1.0))


def test_the_loop_is_closed_on_it(found):
    assert list(found.channels)[-2:] == ['force', 'tool_force']
    assert found.channels['force'].conclusion.effects == ()
    result = found.channels['tool_force']
    assert result.conclusion.effects == ('force_offset',)
    estimate = result.parameters('force_offset')['offset']
    assert abs(estimate.value - 8.0) < 4.0 * estimate.std


def test_report_page_and_bag_have_it(found, tmp_path):
    write_report(found, tmp_path)
    told = json.loads((tmp_path / 'report.json').read_text())['tool_force']
    assert (told['verdict'], told['effects']) == ('effect_added', ['force_offset'])
    assert 'id="tool_force"' in (tmp_path / 'report.html').read_text()
    with AnyReader([tmp_path / 'compare.mcap'], default_typestore=messages.standard_types()) as bag:
        assert {'/measured/measured_tool_force', '/simulated_after/tool_force'} <= set(bag.topics)


def test_it_is_not_there_where_it_was_not_recorded(recording):
    assert 'tool_force' not in identify([replace(recording, others={})]).channels


def test_a_mapping_says_where_it_was_recorded(recording, tmp_path):
    (tmp_path / 'cell.yaml').write_text(
        """
table: {time: {column: 1, unit: s}, delimiter: comma}
displacement: {column: 2, unit: mm}
cylinder_a: {pressure: {column: 3, unit: kPa, reference: absolute}}
others:
  tool_force: {column: 4, unit: lbf}
"""
    )
    table = np.arange(400.0).reshape(100, 4)
    np.savetxt(tmp_path / 'cell.csv', table, delimiter=',')
    read = read_recording(tmp_path / 'cell.csv', mapping=read_mapping(tmp_path / 'cell.yaml'))
    assert read.others['tool_force'].values == pytest.approx(table[:, 3] * 4.4482216)
    part = read.between(4.0, 44.0).others['tool_force']
    assert part.values == pytest.approx(table[1:11, 3] * 4.4482216)
