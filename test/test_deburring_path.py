# SPDX-License-Identifier: Apache-2.0
"""The worked example: a path's surface error becomes a schedule, and the schedule a contact force."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.commands import record_rig
from cfd_pneumatic.recording import read_recording
from studies import deburring_path as example

ROOT = Path(__file__).parents[1]
FORCE = 20.0


def table(along, error):
    return '\n'.join([example.HEAD, *(f'{one!r},{other!r}' for one, other in zip(along, error))]) + '\n'


def forces(along, error):
    """Return what a model of the device predicts along a path [N]."""
    device = example.device_of(None)
    setpoints = device.model.setpoints(FORCE, 70e3)
    return example.predict(device, example.piston_motion(np.array(along), np.array(error), 0.05), setpoints)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('path')
    assert example.main(['--output', str(path), '--force', str(FORCE)]) == 0
    return path


def test_the_rig_plays_the_surface_error(folder, tmp_path):
    assert record_rig.main([str(folder / 'schedule.csv'), '--output', str(tmp_path / 'bag')]) == 0
    displacement = read_recording(tmp_path / 'bag').displacement
    along, error = example.example()
    expected = np.interp(0.05 * (displacement.times - example.REST), along, error - error[0])
    assert np.max(np.abs(displacement.values - expected)) < 2e-5  # the sensor's noise, and stamps that jitter


def test_the_picture_shows_surface_and_force(folder):
    picture = matplotlib.image.imread(folder / 'path.png')
    height, width, _ = picture.shape
    halves = picture[: height // 2], picture[height // 2 :]
    assert width > height > 500
    assert all(np.any(np.ptp(half[:, :, :3], axis=2) == 0.0) for half in halves)  # black curve, grey dashes
    assert np.any(np.ptp(halves[1][:, :, :3], axis=2) > 0.5)  # blue and red curves


@given(st.lists(st.floats(-2e-3, 2e-3), min_size=2, max_size=12), st.floats(0.01, 0.2))
def test_the_piston_reaches_as_far_as_the_surface_lies_behind(errors, feed):
    along = 0.02 * np.arange(len(errors))
    course = example.piston_motion(along, np.array(errors), feed)
    at = np.interp(example.REST + along / feed, course.times, course.displacement)
    fastest = np.max(np.abs(course.velocity))
    np.testing.assert_allclose(at, np.array(errors) - errors[0], atol=fastest * example.PERIOD + 1e-12)
    assert np.ptp(course.displacement) <= np.ptp(errors) + 1e-12
    assert course.displacement[0] == course.velocity[0] == course.velocity[-1] == 0.0


def test_a_burr_presses_harder_and_a_dent_less():
    along = np.linspace(0.0, 0.1, 101)
    bump = 1e-3 * np.exp(-(((along - 0.05) / 5e-3) ** 2))
    burr, dent = forces(along, -bump), forces(along, bump)
    reached = np.argmax(burr)
    assert burr[reached] > FORCE + 1.0
    assert dent[reached] < FORCE - 1.0
    np.testing.assert_allclose([burr[0], burr[-1], dent[0], dent[-1]], FORCE, atol=0.05)


def test_an_own_table_is_followed_with_an_identified_device(tmp_path):
    path = tmp_path / 'edge.csv'
    path.write_text(table([0.1, 0.15, 0.2], [0.0, 1e-3, 5e-4]))
    arguments = [str(path), '--output', str(tmp_path), '--parameters', str(ROOT / 'config/table_2.yaml')]
    assert example.main(arguments) == 0
    assert (tmp_path / 'schedule.csv').read_text().splitlines()[-1].split(',')[1] == '0.0005'


@pytest.mark.parametrize(
    ('text', 'arguments', 'words'),
    [
        ('x,y\n0,0\n1,0\n', [], 'The first line must be along_m,error_m'),
        ('along_m,error_m\n0,0\n0,1e-3\n', [], 'along_m must increase'),
        ('along_m,error_m\n0,a\n', [], 'Give a table of numbers'),
        (table([0.0, 0.1], [0.0, 9e-3]), [], 'deviates by 0.009 m, but the piston reaches only 0.00635 m'),
        (table([0.0, 0.1], [0.0, 0.0]), ['--feed', '0'], '--feed must be a positive speed, is 0 m/s'),
        (table([0.0, 0.1], [0.0, 0.0]), ['--force', '900'], 'Choose a force closer to 0'),
    ],
)
def test_what_cannot_be_followed_is_one_line(tmp_path, capsys, text, arguments, words):
    path = tmp_path / 'edge.csv'
    path.write_text(text)
    output = tmp_path / 'output'
    assert example.main([str(path), '--output', str(output), *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not output.exists()
