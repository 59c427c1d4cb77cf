# SPDX-License-Identifier: Apache-2.0
"""`leak_test` as people call it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.commands.leak_test import main
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.identification import decay_of
from cfd_pneumatic.identification.thresholds import LARGEST_LAW_ERROR, LARGEST_LAW_ERROR_RATIO
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal, write_recording
from cfd_pneumatic.reporting import print_decay
from cfd_pneumatic.terminal import printed

TIMES = 0.05 * np.arange(1200)


@pytest.fixture
def bag(tmp_path):
    """Return a bag of two pressures alone, of which the first holds for 10 s until its valve is shut."""
    rng = np.random.default_rng(0)
    gauge = 4e5 * np.exp(-5e-3 * np.maximum(TIMES - 10.0, 0.0)), 3e5 * np.exp(-8e-3 * TIMES)
    cylinders = {
        name: CylinderSignals(Signal(TIMES, AMBIENT_PRESSURE + one + rng.normal(0.0, 50.0, TIMES.size)), None)
        for name, one in zip(('cylinder_a', 'cylinder_b'), gauge)
    }
    still = Signal(TIMES, np.zeros(TIMES.size))
    write_recording(tmp_path / 'bag', Recording('decay', 0, still, cylinders, None, (), rests=True))
    return tmp_path / 'bag'


def test_it_tells_each_cylinder_s_leak_from_when_the_valve_is_shut(bag, tmp_path, capsys):
    assert main([str(bag), '--begin', '10', '--output', str(tmp_path / 'told')]) == 0
    said = capsys.readouterr().out
    assert 'cylinder_a: 399.7 to 311.8 kPa gauge in 49.95 s' in ' '.join(said.split())
    told = json.loads((tmp_path / 'told' / 'leak.json').read_text())['cylinders']
    for name, conductance in (('cylinder_a', 5e-3), ('cylinder_b', 8e-3)):
        gap, orifice = told[name]['laws']
        assert (gap['law'], gap['excluded'], orifice['law'], orifice['excluded']) == ('gap', False, 'orifice', True)
        assert gap['conductance'] == pytest.approx(conductance, rel=0.01)
        assert f'-p {name}.leakage.conductance:={gap["conductance"]:.4g}' in ' '.join(said.split())
        curve = gap['curve']
        assert curve['rate_pa_per_s'] == pytest.approx(np.multiply(gap['conductance'], curve['gauge_pa']))
        assert np.all(np.less_equal(curve['low'], curve['rate_pa_per_s']))
    assert (tmp_path / 'told' / 'leak.svg').read_text().startswith('<svg')


@pytest.mark.parametrize('noise', [0.5, 500.0])
def test_the_table_explains_settling_and_the_limit_of_the_error(noise):
    fall = 4e5 * np.exp(-5e-3 * TIMES) + 5e3 * np.exp(-TIMES / 5.0)
    pressure = AMBIENT_PRESSURE + fall + np.random.default_rng(0).normal(0.0, noise, TIMES.size)
    decay = decay_of(Signal(TIMES, pressure), AMBIENT_PRESSURE)
    text = printed(lambda console: print_decay('cylinder_a', decay, console))
    assert 'Settling: part of the pressure' in text
    least = max(decay.best.error, decay.noise)
    limit = min(LARGEST_LAW_ERROR * decay.noise, LARGEST_LAW_ERROR_RATIO * least)
    assert f'A model is excluded if its error exceeds {limit:.4g} Pa.' in text
    assert [leak.excluded for leak in decay.leaks] == [leak.error > limit for leak in decay.leaks]
    for leak in decay.leaks:
        (row,) = (line for line in text.splitlines() if line.startswith(f'│ {leak.characteristic}'))
        low, _, high = row.split('│')[3].strip().partition(' to ')
        assert low != high
        assert float(low) == pytest.approx(leak.interval[0], rel=5e-3)
        assert row.count('none') == (0 if leak.settling else 2)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--begin', '59.9'], 'cylinder_a/pressure: 2 samples are too few'),
        (['--begin', '5', '--end', '1'], '--begin 5 --end 1: both are seconds after the first sample'),
        (['--begin', '-1'], '--begin -1 --end inf: both are seconds'),
        (['--begin', '1e9'], 'cylinder_a/pressure: 0 samples are too few'),
        (['--begin', 'nan'], "'nan' is not a finite number"),
        (['--ambient-pressure', '6e5'], 'is outside 10000 to 200000 Pa'),
        (['--namespace', '/other'], 'in the namespace /other'),
    ],
)
def test_what_it_can_not_tell_it_refuses_in_one_line(bag, options, message, capsys):
    assert main([str(bag), *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('leak_test: error: ')
    assert message in line


def test_identify_bag_says_whose_work_it_is(bag, tmp_path, capsys):
    assert identify_bag([str(bag), '--output', str(tmp_path / 'identified'), '--progress', 'none']) == 2
    said = capsys.readouterr().err
    assert 'no displacement was recorded, and no set-point changes' in said
    assert 'leak_test' in said
