# SPDX-License-Identifier: Apache-2.0
"""
How much faster two workers do a plant than one: the whole program on 200 bags, from its start to its end.

The bags are a minute of surface following each, four different ones again and again. The efficiency is the time that
one worker takes over twice the time that two take.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from cfd_pneumatic.commands import record_rig_main as record_rig

pytest.importorskip('distributed')

PROGRAM = [sys.executable, '-m', 'cfd_pneumatic.commands.identify_bag']
BAGS = 200
DIFFERENT = 4

seconds: dict[int, float] = {}


@pytest.fixture(scope='module')
def plant(tmp_path_factory):
    home = tmp_path_factory.mktemp('plant')
    for seed in range(DIFFERENT):
        bag = home / str(seed)
        assert record_rig(['surface_following', '--duration', '60', '--seed', str(seed), '--output', str(bag)]) == 0
    for number in range(BAGS):
        target = home / 'plant' / f'cell_{number // 10}' / f'shift_{number % 10}'
        shutil.copytree(home / str(number % DIFFERENT), target, copy_function=os.link)
    return home / 'plant'


@pytest.mark.benchmark(group=f'identify {BAGS} bags')
@pytest.mark.parametrize('workers', [1, 2])
def test_a_plant(benchmark, plant, tmp_path, workers, capsys):
    command = [*PROGRAM, str(plant), '--each', '--jobs', str(workers), '--output', str(tmp_path), '--progress', 'none']
    run = benchmark.pedantic(
        subprocess.run, args=(command,), kwargs={'check': True, 'stdout': subprocess.PIPE}, rounds=1
    )
    assert run.stdout.startswith(f'{BAGS} bags of {BAGS // 10} devices, 0 failed'.encode())
    seconds[workers] = benchmark.stats.stats.min
    if len(seconds) == 2:
        with capsys.disabled():
            print(f'\n{seconds[1]:.1f} s, {seconds[2]:.1f} s: efficiency {seconds[1] / (2.0 * seconds[2]):.2f}')
