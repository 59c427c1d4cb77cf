# SPDX-License-Identifier: Apache-2.0
"""Schedules from a file: what is played is what stands there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import schedule_named, written_schedule

HEAD = ','.join(SCHEDULE_COLUMNS)


def write(path: Path, *rows: str, head: str = HEAD) -> Path:
    path.write_text('\n'.join([head, *rows]) + '\n')
    return path


@pytest.fixture
def smooth(tmp_path: Path) -> Path:
    """Return a file with a sine of a millimetre out and back, and a step of both set-points."""
    times = np.round(0.002 * np.arange(501), 9)
    x, v = 5e-4 * (1.0 - np.cos(2.0 * np.pi * times)), 1e-3 * np.pi * np.sin(2.0 * np.pi * times)
    level = np.where(times >= 0.5, 6e4, 3e4)
    rows = zip(times, x, v, level, level - 1e3)
    return write(tmp_path / 'smooth.csv', *(','.join(map(repr, map(float, row))) for row in rows))


@pytest.mark.parametrize('period', [2e-3, 1e-3, 5e-3])
def test_it_is_played_as_it_stands_there_at_any_rate(smooth: Path, period: float) -> None:
    schedule = written_schedule(smooth, sampling_period=period)
    assert schedule.name == 'smooth'
    assert schedule.duration == pytest.approx(1.0)
    knots = period / schedule.knots_per_sample * np.arange(1 - schedule.knots_per_sample, schedule.positions.size)
    times = np.maximum(knots[: schedule.positions.size], 0.0)
    assert schedule.positions == pytest.approx(5e-4 * (1.0 - np.cos(2.0 * np.pi * times)), abs=1e-9)
    assert schedule.velocities == pytest.approx(1e-3 * np.pi * np.sin(2.0 * np.pi * times), abs=1e-6)


def test_a_set_point_holds_from_its_row_on(smooth: Path) -> None:
    """It acts on the way to the sample after its own time."""
    schedule = written_schedule(smooth)
    (changed,) = np.flatnonzero(np.diff(schedule.setpoints[:, 0]))
    assert changed * schedule.sampling_period == pytest.approx(0.5)
    assert schedule.setpoints[[0, -1]].tolist() == [[3e4, 2.9e4], [6e4, 5.9e4]]


def test_it_is_known_by_its_file_name_and_takes_no_other_option(smooth: Path) -> None:
    named = schedule_named(str(smooth), sampling_period=2e-3)
    assert np.array_equal(named.positions, written_schedule(smooth).positions)
    with pytest.raises(InputError, match="has no option 'setpoint': its options are sampling_period"):
        schedule_named(str(smooth), setpoint=1e4)


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        (['0,0,0,3e4,3e4'], 'two rows or more'),
        (['0,0,0,3e4,3e4', '1,0,0,3e4'], 'each row must have 5 numbers'),
        (['0,0,0,3e4,3e4', '1,0,0,3e4,here'], 'each row must have 5 numbers'),
        (['0,0,0,3e4,3e4', '1,nan,0,3e4,3e4'], 'finite numbers'),
        (['0,0,0,3e4,3e4', '1,0,0,3e4,3e4', '1,0,0,3e4,3e4'], 'times that increase'),
        (['1,0,0,3e4,3e4', '2,0,0,3e4,3e4'], 'from 0 on'),
        ([], 'two rows or more'),
        (['0,0,0,3e4,3e4', '100000,0,0,3e4,3e4'], 'takes 100000 s, at most 1200 s: make it shorter'),
        (['0,0,0,3e4,3e4', '1e9,0,0,3e4,3e4'], 'takes 1e+09 s, at most 1200 s: make it shorter'),
        (['0,0,0,3e4,3e4', '1e308,0,0,3e4,3e4'], 'at most 1200 s: make it shorter'),
        (['0,0,0,3e4,3e4', '1e-9,0,0,3e4,3e4'], 'has 1 samples, but must have 2 or more: make it longer'),
        (['0,0,0,3e4,3e4', '1,1e300,1e300,3e4,3e4'], 'out of reach'),
        (['0,0,0,3e4,3e4', '1e-320,1,0,3e4,3e4', '1,0,0,3e4,3e4'], 'a piston cannot follow its displacements'),
        (['0,1e308,-1e308,3e4,3e4', '1,-1e308,1e308,3e4,3e4'], 'a piston cannot follow its displacements'),
    ],
)
def test_what_is_no_schedule_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: list[str], message: str
) -> None:
    file = write(tmp_path / 'bad.csv', *rows)
    assert record_rig([str(file), '--output', str(tmp_path / 'bag')]) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


def test_another_table_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='its first line must be time_s,displacement_m'):
        written_schedule(write(tmp_path / 'other.csv', '0,0', head='t,x'))
    with pytest.raises(InputError, match='No such file'):
        written_schedule(tmp_path / 'none.csv')
    (tmp_path / 'empty.csv').write_text('')
    with pytest.raises(InputError, match='is not a schedule: its first line must be'):
        written_schedule(tmp_path / 'empty.csv')
