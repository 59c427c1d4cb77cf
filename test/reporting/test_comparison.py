# SPDX-License-Identifier: Apache-2.0
"""`compare.mcap`, read back by rosbags and by our reader."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from identified import closed, closed_on_two, open_loop, recording, with_force
from rosbags.highlevel import AnyReader

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import identify
from cfd_pneumatic.messages.types import FLUID_PRESSURE, NANOSECONDS, WRENCH_STAMPED, standard_types
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.reporting import compare_files, write_report
from cfd_pneumatic.reporting.comparison import write_comparison


def series(path):
    """Return for each topic its type, its times of reception [ns], its stamps [ns] and its numbers."""
    found = {}
    with AnyReader([path], default_typestore=standard_types()) as reader:
        for connection, time, payload in reader.messages():
            message = reader.deserialize(payload, connection.msgtype)
            stamp = getattr(message, 'header', None)
            nanoseconds = None if stamp is None else stamp.stamp.sec * NANOSECONDS + stamp.stamp.nanosec
            row = found.setdefault(connection.topic, (connection.msgtype, [], [], []))
            row[1].append(time)
            row[2].append(nanoseconds)
            row[3].append(message.fluid_pressure if connection.msgtype == FLUID_PRESSURE else value_of(message))
    return found


def value_of(message):
    if hasattr(message, 'wrench'):
        return message.wrench.force.x
    return message.data if hasattr(message, 'data') else message.position[0]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('compared')
    write_report(with_force(closed()), path)
    return path


@pytest.fixture(scope='module')
def topics(folder):
    return series(folder / 'compare.mcap')


@pytest.mark.parametrize('cylinder', ['cylinder_a', 'cylinder_b'])
def test_pressures_and_residuals_are_those_of_the_identification(topics, cylinder):
    result = closed().cylinders[cylinder]
    (compared,) = result.comparisons
    measured, before, after = compared.experiment.measured, compared.before, compared.after
    expected = {
        'measured': measured,
        'simulated_before': before,
        'simulated_after': after,
        'residual_before': measured - before,
        'residual_after': measured - after,
    }
    for space, values in expected.items():
        msgtype, times, stamps, found = topics[f'/{space}/{cylinder}/pressure']
        assert msgtype == FLUID_PRESSURE
        assert times == stamps
        np.testing.assert_array_equal(found, values)


def test_the_time_line_is_the_recordings_own(topics):
    (original,) = closed().recordings
    stamps = original.epoch + np.rint(original.cylinders['cylinder_a'].pressure.times * NANOSECONDS).astype(np.int64)
    for space in ('measured', 'simulated_after', 'residual_before'):
        np.testing.assert_array_equal(topics[f'/{space}/cylinder_a/pressure'][1], stamps)


def test_the_force_is_there_too(topics):
    for topic in ('/measured/measured_force', '/simulated_before/contact_force', '/residual_after/contact_force'):
        assert topics[topic][0] == WRENCH_STAMPED
    measured, after, left = (
        np.array(topics[topic][3])
        for topic in ('/measured/measured_force', '/simulated_after/contact_force', '/residual_after/contact_force')
    )
    np.testing.assert_allclose(left, measured - after)


def test_what_was_measured_is_a_recording_again(folder):
    (original,) = closed().recordings
    again = read_recording(folder / 'compare.mcap', namespace='/measured')
    assert again.epoch == original.epoch
    np.testing.assert_array_equal(again.displacement.values, original.displacement.values)
    for cylinder, signals in original.cylinders.items():
        np.testing.assert_array_equal(again.cylinders[cylinder].pressure.values, signals.pressure.values)
        np.testing.assert_allclose(again.cylinders[cylinder].setpoint.values, signals.setpoint.values)
    np.testing.assert_array_equal(again.force.values, original.force.values)
    gains, expected = (one.cylinders['cylinder_a'].fit.model.parameters for one in (identify([again]), open_loop()))
    np.testing.assert_allclose(gains, expected, rtol=1e-3)


def test_several_recordings_have_a_file_each(tmp_path):
    identification = closed_on_two()
    paths = compare_files(identification, tmp_path)
    assert [path.name for path in paths] == ['compare_1.mcap', 'compare_2.mcap']
    write_report(identification, tmp_path)
    for path, original in zip(paths, identification.recordings):
        found = series(path)['/measured/cylinder_a/pressure'][3]
        np.testing.assert_array_equal(found, original.cylinders['cylinder_a'].pressure.values)


def test_nothing_is_left_beside_the_results_and_outdated_ones_go(tmp_path):
    (tmp_path / 'mine.mcap').write_text('')
    write_report(closed_on_two(), tmp_path)
    write_report(closed(), tmp_path)
    assert names(tmp_path) == ['compare.mcap', 'mine.mcap', 'parameters.yaml', 'report.html', 'report.json']
    write_report(open_loop(), tmp_path)
    assert names(tmp_path) == ['mine.mcap', 'parameters.yaml', 'report.json']


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_failure_leaves_the_earlier_file(folder, tmp_path, monkeypatch):
    shutil.copy(folder / 'compare.mcap', tmp_path)
    earlier = (tmp_path / 'compare.mcap').read_bytes()

    def full(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('os.replace', full)
    with pytest.raises(InputError, match='No space left'):
        write_comparison(tmp_path / 'compare.mcap', closed(), 0)
    assert (tmp_path / 'compare.mcap').read_bytes() == earlier
    assert names(tmp_path) == ['compare.mcap']


def test_times_that_fit_no_stamp_are_said(tmp_path):
    late = replace(closed(), recordings=(replace(recording(), epoch=2**31 * NANOSECONDS),))
    with pytest.raises(InputError, match='do not fit a stamp'):
        write_comparison(tmp_path / 'compare.mcap', late, 0)
