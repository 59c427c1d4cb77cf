"""A long recording: identified as a short one is, in the same memory."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from drawn import recording_of
from long_bag import GAINS, write_long_bag

from cfd_pneumatic.identification import identify
from cfd_pneumatic.identification.data import experiment
from cfd_pneumatic.recording import spool
from cfd_pneumatic.rig.panel import draw

MiB = 2**20


@pytest.mark.parametrize(('schedule', 'setpoint_recorded'), [('out_and_back', True), ('paper_step', False)])
def test_in_small_parts_and_in_files_the_same_is_identified(monkeypatch, schedule, setpoint_recorded):
    recording = recording_of(draw(None, schedule, 66))
    if not setpoint_recorded:
        cylinder = replace(recording.cylinders['cylinder_a'], setpoint=None)
        recording = replace(recording, cylinders={'cylinder_a': cylinder})
    whole = identify([recording]).cylinders['cylinder_a']
    for module, name in ((spool, 'PART'), (experiment, 'PART'), (experiment, '_BLOCK')):
        monkeypatch.setattr(module, name, 128)
    monkeypatch.setattr(spool, '_IN_MEMORY', 0)
    parts = identify([recording]).cylinders['cylinder_a']
    for one, other in zip(whole.experiments, parts.experiments):
        for name in ('times', 'displacement', 'setpoint', 'samples', 'pressure', 'part'):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(parts.fit.gains, whole.fit.gains, rtol=1e-9)
    assert [one.std for one in parts.fit.estimates] == pytest.approx([one.std for one in whole.fit.estimates], rel=1e-6)
    assert parts.noise_floor == pytest.approx(whole.noise_floor)
    assert parts.span == pytest.approx(whole.span)
    assert {name: one.rmse for name, one in parts.before.items()} == pytest.approx(
        {name: one.rmse for name, one in whole.before.items()}
    )


def test_stretches_tell_the_noise_of_a_long_recording(monkeypatch):
    recording = recording_of(draw(None, 'out_and_back', 66))
    whole = identify([recording]).cylinders['cylinder_a']
    (one,) = whole.experiments
    monkeypatch.setattr(experiment, '_STRETCH', one.samples.size // 20)
    stretches = list(one.stretches())
    assert len(stretches) == 16
    for part, samples in stretches:
        np.testing.assert_array_equal(part.pressure, one.pressure[samples])
        np.testing.assert_array_equal(part.sample_times, one.sample_times[samples])
    assert identify([recording]).cylinders['cylinder_a'].noise_floor == pytest.approx(whole.noise_floor, rel=0.1)


IDENTIFIED = """\
import resource, sys
from cfd_pneumatic.identification import identify
from cfd_pneumatic.recording import read_recording
for path in sys.argv[1:]:
    found = identify([read_recording(path, spool=sys.argv[1] + '/..')])
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, *found.cylinders['cylinder_a'].fit.gains)
"""


@pytest.mark.skipif(not sys.platform.startswith('linux'), reason='elsewhere ru_maxrss has another unit')
def test_a_recording_of_five_times_the_length_needs_no_more_memory(tmp_path):
    """The arrays that are made of the longer one take 200 MiB more."""
    bags = [
        write_long_bag(tmp_path / name, samples).parent for name, samples in (('short', 200_000), ('long', 1_000_000))
    ]
    run = [sys.executable, '-c', IDENTIFIED, *map(str, bags)]
    lines = subprocess.run(run, check=True, capture_output=True, text=True).stdout.split('\n')
    (short, *_), (long, *gains) = ([float(word) for word in line.split()] for line in lines[:2])
    print(f'a recording of five times the length needs {(long - short) / MiB:.0f} MiB more')
    assert long - short < 40 * MiB
    np.testing.assert_allclose(gains, GAINS, rtol=1e-3)
