# SPDX-License-Identifier: Apache-2.0
"""A long recording: identified as a short one is, in memory that grows no faster than it."""

from __future__ import annotations

import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from drawn import recording_of

from cfd_pneumatic.identification import ChannelResult, Options, identify
from cfd_pneumatic.identification.data import experiment, motion
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.fit import likelihood
from cfd_pneumatic.identification.fit.likelihood import Likelihood
from cfd_pneumatic.rig import surface_following
from studies.panel import draw
from studies.trials.long_bag import GAINS, write_long_bag


def test_in_small_parts_the_same_is_identified(monkeypatch):
    recording = recording_of(draw(None, 'out_and_back', 66))
    whole = identify([recording]).channels['cylinder_a']
    monkeypatch.setattr(motion, 'GRID_PIECE', 128)
    monkeypatch.setattr(experiment, 'BLOCK_SAMPLES', 128)
    parts = identify([recording]).channels['cylinder_a']
    for one, other in zip(whole.experiments, parts.experiments):
        np.testing.assert_allclose(one.times, other.times, rtol=1e-14)
        for name, values in one.inputs.items():
            np.testing.assert_allclose(values, other.inputs[name], rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(parts.fit.model.parameters, whole.fit.model.parameters, rtol=1e-9)
    assert [one.std for one in parts.fit.estimates] == pytest.approx([one.std for one in whole.fit.estimates], rel=1e-6)


class Both(NamedTuple):
    """The loop over a whole recording and over stretches of it, and the stretches, in a fit's likelihood."""

    whole: ChannelResult
    found: ChannelResult
    telling: Likelihood


@pytest.fixture(scope='module')
def both():
    recording = recording_of(draw('leakage', surface_following(60e3, duration=40.0, seed=66), 66))
    options = Options(close_loop=True)
    whole = identify([recording], options).channels['cylinder_a']
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(likelihood, 'STRETCH_SAMPLES', whole.fit.simulated[0].size // 90)
        found = identify([recording], options).channels['cylinder_a']
        return Both(whole, found, whole.fit.likelihood.representative())


def test_stretches_stand_for_a_long_recording(both):
    """They hold its samples, of train and validation, from its beginning to its test part, and tell its noise."""
    (one,) = both.whole.experiments
    assert len(both.telling.experiments) >= 20
    for part in both.telling.experiments:
        at = np.searchsorted(one.sample_times, part.sample_times)
        np.testing.assert_array_equal(part.sample_times, one.sample_times[at])
        np.testing.assert_array_equal(part.measured, one.measured[at])
        np.testing.assert_array_equal(part.at_samples('displacement'), one.at_samples('displacement')[at])
    begins = np.array([part.times[0] for part in both.telling.experiments])
    end = one.sample_times[one.fitted][-1]
    assert begins[0] == one.times[0]
    assert np.max(np.diff(begins, append=end)) < 0.1 * end
    assert {PARTS[part.part[0]] for part in both.telling.experiments} == {'train', 'validation'}
    assert both.found.noise.std == pytest.approx(both.whole.noise.std, rel=0.1)


def test_what_stretches_leave_is_what_the_whole_leaves(both):
    """A stretch starts as measured, and its first samples don't count; soon that is forgotten."""
    whole = both.whole.fit
    (one,) = whole.likelihood.experiments
    for part, simulated in zip(both.telling.experiments, both.telling.simulate(whole.model)):
        assert part.starts_with_recording == np.all(part.counts)
        at = np.searchsorted(one.sample_times, part.sample_times)
        forgotten = part.sample_times > part.times[0] + 0.3
        assert np.any(forgotten)
        np.testing.assert_allclose(simulated[forgotten], whole.simulated[0][at][forgotten], rtol=0.0, atol=1.0)


def test_the_loop_over_stretches_names_what_the_whole_names(both):
    whole, found, _ = both
    assert found.conclusion.verdict == whole.conclusion.verdict == 'effect_added'
    assert found.conclusion.effects == whole.conclusion.effects == ('leakage',)
    assert found.after['test'].rmse == pytest.approx(whole.after['test'].rmse, rel=1e-3)


IDENTIFIED = """\
import resource, sys
from cfd_pneumatic.identification import identify
from cfd_pneumatic.recording import read_recording
for path in sys.argv[1:]:
    found = identify([read_recording(path, folder=sys.argv[1] + '/..')])
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, *found.channels['cylinder_a'].fit.model.parameters)
"""


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith('linux'), reason='elsewhere ru_maxrss has another unit')
def test_a_recording_of_five_times_the_length_needs_that_much_more_memory_at_most(tmp_path):
    """Four hours at 1 kHz of two cylinders are to be identified in 4 GB: 280 bytes for each sample."""
    bags = [write_long_bag(tmp_path / name, samples).parent for name, samples in (('short', 50_000), ('long', 250_000))]
    run = [sys.executable, '-c', IDENTIFIED, *map(str, bags)]
    lines = subprocess.run(run, check=True, capture_output=True, text=True).stdout.split('\n')
    (short, *_), (long, *gains) = ([float(word) for word in line.split()] for line in lines[:2])
    print(f'each further sample needs {(long - short) / 200_000:.0f} bytes')
    assert long - short < 280 * 200_000
    np.testing.assert_allclose(gains, GAINS, rtol=1e-3)
