# SPDX-License-Identifier: Apache-2.0
"""`record_rig`: a test on the rig as a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cfd_pneumatic.commands.record_rig import main
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.rig import DEVICES, out_and_back, paper_step, record, with_changes
from cfd_pneumatic.units import PSI


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_the_bag_holds_what_the_sensors_read(tmp_path: Path, storage: str) -> None:
    bag = tmp_path / 'bag'
    assert main(['out_and_back', '--output', str(bag), '--seed', '4', '--storage', storage]) == 0
    expected = record(out_and_back(), seed=4)
    read = read_recording(bag)
    times = expected.times - expected.times[0]
    assert read.displacement.times == pytest.approx(times, abs=2e-9)
    assert np.array_equal(read.displacement.values, expected.displacement)
    assert read.force is not None
    assert np.array_equal(read.force.values, expected.force)
    for index, cylinder in enumerate(('cylinder_a', 'cylinder_b')):
        assert np.array_equal(read.cylinders[cylinder].pressure.values, expected.pressures[:, index])


def test_a_set_point_holds_from_the_sample_before_it_was_felt(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    main(['out_and_back', '--output', str(bag)])
    expected = record(out_and_back())
    setpoint = read_recording(bag).cylinders['cylinder_a'].setpoint
    assert setpoint is not None
    changed = np.flatnonzero(np.diff(expected.setpoints[:, 0]))
    assert setpoint.times[0] == 0.0
    assert setpoint.times[1:] == pytest.approx(expected.times[changed] - expected.times[0], abs=2e-9)
    assert setpoint.values[1:] == pytest.approx(expected.setpoints[changed + 1, 0])


def test_options_reach_the_schedule(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    options = ['--setpoint', '100e3', '--setpoint-b', '50e3', '--amplitude', '1e-3', '--namespace', '/cell']
    assert main(['paper_step', '--output', str(bag), *options]) == 0
    read = read_recording(bag, namespace='/cell')
    assert read.displacement.values[-1] == pytest.approx(1e-3, abs=5e-6)
    assert read.cylinders['cylinder_b'].setpoint is not None
    assert read.cylinders['cylinder_b'].setpoint.values == pytest.approx([101325 + 50e3])


def test_faults_and_the_device_are_those_of_the_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / 'bag'
    faults = 'effects_a.leak_conductance=1e-9 pickup.force_offset=5'
    assert main(['paper_step', '--device', 'paper', '--faults', faults, '--output', str(bag)]) == 0
    assert capsys.readouterr().out == (
        f'bag written to the folder {bag}: paper_step, 350 samples in 0.698 s; faults: {faults}\n'
    )
    changes = {'effects_a.leak_conductance': 1e-9, 'pickup.force_offset': 5.0}
    expected = record(paper_step(), with_changes(DEVICES['paper'], changes))
    read = read_recording(bag)
    assert np.array_equal(read.cylinders['cylinder_a'].pressure.values, expected.pressures[:, 0])
    assert read.force is not None
    assert np.array_equal(read.force.values, expected.force)


def test_the_same_seed_gives_the_same_surface(tmp_path: Path) -> None:
    displacements = []
    for name, seed in (('one', '1'), ('again', '1'), ('other', '2')):
        main(['surface_following', '--duration', '3', '--seed', seed, '--output', str(tmp_path / name)])
        displacements.append(read_recording(tmp_path / name).displacement.values)
    assert np.array_equal(displacements[0], displacements[1])
    assert not np.array_equal(displacements[0], displacements[2])


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['paper_step', '--duration', '3'], "schedule 'paper_step' has no option 'duration': its options are setpoint"),
        (['paper_step', '--setpoint', '1e6'], 'between vacuum and the supply'),
        (
            ['paper_step', '--amplitude', '60e-3'],
            'a displacement of 60 mm is out of reach: the piston travels 6.35 mm to either side',
        ),
        (['surface_following', '--duration', 'inf'], "--duration: 'inf' is not a finite number"),
        (['paper_step', '--amplitude', 'nan'], "--amplitude: 'nan' is not a finite number"),
        (['surface_following', '--amplitude', '0'], 'must be above 0 m'),
        (['paper_step', '--namespace', '../x'], 'namespace ../x: give one as ROS 2 has it'),
        (['paper_step', '--namespace', '/a' * 1000], 'give one as ROS 2 has it'),
        (['paper_step', '--seed', '-1'], '--seed -1'),
        (['paper_step', '--faults', 'leak'], "'faults': 'leak' must be NAME=NUMBER"),
        (
            ['paper_step', '--faults', 'seal.coulomb=1'],
            "'faults': seal.coulomb cannot be a fault; give PART.NAME=NUMBER with a part of effects_a",
        ),
    ],
)
def test_what_cannot_be_recorded_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main([*arguments, '--output', str(tmp_path / 'bag')]) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.startswith('record_rig: error: ')
    assert errors.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_a_bag_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ['paper_step', '--output', str(tmp_path / 'bag'), '--setpoint', str(5 * PSI)]
    assert main(arguments) == 0
    assert main(arguments) == 2
    assert 'exists already' in capsys.readouterr().err
    for option in ('--overwrite', '--force'):  # its former name
        assert main([*arguments, option]) == 0
