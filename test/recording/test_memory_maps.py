# SPDX-License-Identifier: Apache-2.0
"""A recording that is kept in files, and gone over part by part, is the same as in memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_cases import EPOCH, SECOND, assert_same, piston, plain_messages, pressure, setpoint, write_bag

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import memory_maps, read_recording
from cfd_pneumatic.recording.memory_maps import allocate, parts
from studies.trials.long_bag import write_long_bag

MILLISECOND = SECOND // 1000
APPLIED = '/cfd/device/cylinder_a/setpoint_applied'


@st.composite
def any_bag(draw):
    """Draw messages whose stamps repeat themselves, are late or missing, and whose numbers may not be finite."""

    def some(make):
        times = draw(st.lists(st.integers(0, 900), min_size=1, max_size=30))
        for count, time in enumerate(times):
            number = draw(st.sampled_from([0.5, 1.0, float(count), np.nan, np.inf]))
            yield make(number, EPOCH + time * MILLISECOND, EPOCH + count * MILLISECOND)

    contents = [piston(0.0, EPOCH), pressure(2e5, EPOCH), *some(lambda x, t, r: piston(x, t, received=r))]
    contents += some(lambda x, t, r: pressure(x, draw(st.sampled_from([t, t, 0])), received=r))
    if draw(st.booleans()):
        contents += some(lambda x, t, r: setpoint(x, t))
        contents += [setpoint(1.0, EPOCH)]
    else:
        contents += some(lambda x, t, r: pressure(x, t, received=r, topic=APPLIED))
        contents += [pressure(1e5, EPOCH, topic=APPLIED)]
    return contents


@settings(max_examples=settings.default.max_examples // 2)
@given(contents=any_bag(), part=st.integers(1, 8))
def test_in_files_and_in_small_parts_a_recording_is_the_same(tmp_path_factory, contents, part):
    folder = tmp_path_factory.mktemp('bags')
    write_bag(folder / 'bag', contents)
    whole = read_recording(folder / 'bag')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory_maps, 'PART', part)
        mapped = read_recording(folder / 'bag', folder=folder)
    assert_same(mapped, whole)
    assert mapped.health == whole.health
    assert [path.name for path in folder.iterdir()] == ['bag']


def test_a_signal_can_be_gone_over_in_parts(tmp_path, monkeypatch):
    write_bag(tmp_path / 'bag', plain_messages(20))
    monkeypatch.setattr(memory_maps, 'PART', 6)
    signal = read_recording(tmp_path / 'bag', folder=tmp_path).displacement
    pieces = list(signal.parts())
    assert [len(piece) for piece in pieces] == [6, 6, 6, 2]
    np.testing.assert_array_equal(np.concatenate([piece.times for piece in pieces]), signal.times)
    np.testing.assert_array_equal(np.concatenate([piece.values for piece in pieces]), signal.values)


def test_what_is_written_to_a_file_is_still_there_when_memory_was_given_back(tmp_path):
    array = allocate(200_000, np.float64, tmp_path)
    for part in parts(array):
        array[part] = np.arange(part.start, part.stop)
    assert list(tmp_path.iterdir()) == []
    np.testing.assert_array_equal(array, np.arange(200_000))


def test_a_folder_that_is_not_there_is_told(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages())
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / 'bag', folder=tmp_path / 'nowhere')
    assert str(caught.value) == (
        f'{tmp_path}/bag: 0.0 MB of it cannot be kept in {tmp_path}/nowhere: No such file or directory; '
        'name a folder with more room in TMPDIR'
    )


def test_a_disk_that_is_too_small_is_told_before_it_is_filled(tmp_path, monkeypatch):
    free = os.statvfs(tmp_path)
    monkeypatch.setattr(os, 'posix_fallocate', None)
    with pytest.raises(InputError, match=r'MB of it cannot be kept in .*: No space left on device'):
        allocate(free.f_bavail * free.f_frsize, np.float64, tmp_path)
    with pytest.raises(InputError, match='MB of it cannot be kept in memory: '):
        allocate(2**58, np.float64, None)


WITHIN = """\
import re, resource, sys
from cfd_pneumatic.recording import read_recording
read_recording(sys.argv[1])  # what is loaded when it is first needed
data = int(re.search(r'VmData:\\s+(\\d+)', open('/proc/self/status').read())[1]) * 1024
resource.setrlimit(resource.RLIMIT_DATA, (data + 12_000_000,) * 2)
print(len(read_recording(sys.argv[2], folder=sys.argv[3] or None).displacement))
"""


@pytest.mark.skipif(not Path('/proc/self/status').exists(), reason='no /proc here to tell the memory in use')
@pytest.mark.parametrize('storage', ['mcap', pytest.param('sqlite3', marks=pytest.mark.long)])
def test_a_recording_in_files_needs_little_memory(tmp_path, storage):
    """Its samples alone are 20 MB; without files they don't fit."""
    file = write_long_bag(tmp_path / 'long', 250_000, storage)
    small = write_long_bag(tmp_path / 'small', 1000, storage)

    def read(folder):
        run = [sys.executable, '-c', WITHIN, str(small), str(file), folder]
        return subprocess.run(run, check=False, capture_output=True, text=True)

    assert read(str(tmp_path)).stdout == '250000\n', read(str(tmp_path)).stderr
    assert 'MB of it cannot be kept in memory' in read('').stderr
