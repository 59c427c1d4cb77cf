# SPDX-License-Identifier: Apache-2.0
"""Which effects a recording could not have shown: what physics says, and what a search finds in it."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from drawn import CHANNEL, alike, experiments_of, model, moved, recording_of, whole, with_pressure
from reference import AMBIENT, PSI, step_like

from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.fit.fit import find_optimum, fit_model
from cfd_pneumatic.identification.residual.noise import Noise
from cfd_pneumatic.identification.search.thresholds import SHOWN, STRENGTH
from cfd_pneumatic.identification.search.visible_effects import effects_not_visible
from cfd_pneumatic.model import TABLE_1
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS
from studies.panel import draw

GAINS = np.array(TABLE_1.table[0, 1:])
MODEL = model(GAINS)
PERIOD = 0.002
STD = 52.0


def white(std):
    return Noise(std, np.empty(0), 0.02, True, False)


def unseen(experiment, known, std=STD, library=PRESSURE_EFFECTS):
    """Return what an experiment could not show beside a model, in noise of some size [Pa]."""
    channel = Pressure('cylinder_a', AMBIENT)
    channel.library = library
    likelihood = alike([experiment], channel=channel)
    return effects_not_visible(likelihood, known, white(std))


def hidden(experiment, std=STD, known=MODEL, library=PRESSURE_EFFECTS):
    """Return what an experiment could not show if a model were true."""
    return unseen(with_pressure(experiment, known), known, std, library=library)


def recorded(levels=(5.0,), heights=(1.5e-3, 0.0), rest=0.3, stroke=0.012, period=PERIOD):
    """Return an experiment that goes to each height at each set-point [psi]."""
    duration = rest * (1 + len(heights) * len(levels))
    times = np.arange(round(duration / period)) * period
    displacement, setpoint = np.zeros(times.size), np.full(times.size, AMBIENT + levels[0] * PSI)
    at, before = rest, 0.0
    for level in levels:
        setpoint[times > at] = AMBIENT + level * PSI
        for height in heights:
            displacement += step_like(at + 0.02, stroke, height - before)(times)
            at, before = at + rest, height
    return moved(times, displacement, setpoint)


ONE_LEVEL = recorded(heights=(1.5e-3,))
TWO_LEVELS = recorded(levels=(5.0, 10.0, 5.0), heights=(1.5e-3, 0.0))


def test_a_leak_shows_at_two_set_points_and_not_at_one():
    """At one set-point it is absorbed by the set-point's offset."""
    assert 'leakage' in hidden(ONE_LEVEL)
    assert 'leakage' not in hidden(TWO_LEVELS)


def test_pressure_dependent_gains_show_at_two_set_points_and_not_at_one():
    assert 'operating_point' in hidden(ONE_LEVEL)
    assert 'operating_point' not in hidden(TWO_LEVELS)


def test_a_delay_shows_with_fast_motion_and_not_without():
    assert 'transport_delay' not in hidden(ONE_LEVEL)
    assert 'transport_delay' in hidden(recorded(heights=(1.5e-5,)))
    assert 'transport_delay' in hidden(recorded(stroke=0.25))


@pytest.mark.parametrize('name', ['setpoint_delay', 'setpoint_lag'])
def test_a_late_set_point_shows_where_set_points_step(name):
    assert name in hidden(ONE_LEVEL)
    assert name not in hidden(TWO_LEVELS)
    assert name in hidden(TWO_LEVELS, std=2e4)


def test_saturation_shows_with_steps_of_the_set_point_and_not_with_small_strokes():
    assert 'flow_saturation' in hidden(recorded(heights=(1e-4, 0.0)))
    assert 'flow_saturation' not in hidden(recorded(levels=(5.0, 12.0, 5.0), heights=(1e-4, 0.0)))


def test_a_change_of_volume_shows_over_the_whole_travel():
    assert 'volume_variation' in hidden(recorded(heights=(1e-3,)))
    assert 'volume_variation' not in hidden(recorded(heights=(1.5e-2, 0.0), stroke=0.06))


def test_a_drift_shows_in_time():
    """A given drift, that is: a tenth of a psi each minute."""
    drift = replace(PRESSURE_EFFECTS['set_point_drift'], starts=lambda data: [(0.1 * PSI / 60.0,)])
    seen = [hidden(recorded(rest=rest), library={'set_point_drift': drift}) for rest in (0.3, 10.0)]
    assert seen == [('set_point_drift',), ()]


FIXED = [
    name
    for name, effect in PRESSURE_EFFECTS.items()
    if all(
        effect.starts({**CHANNEL.data([ONE_LEVEL], MODEL, [ONE_LEVEL.measured]), 'residual': residual})
        == effect.starts({**CHANNEL.data([ONE_LEVEL], MODEL, [ONE_LEVEL.measured]), 'residual': 1.0})
        for residual in (10.0, 100.0)
    )
]
"""Effects that are asked for at a strength of their own, not at the noise's."""


@pytest.mark.parametrize('experiment', [ONE_LEVEL, TWO_LEVELS], ids=['one', 'two'])
def test_more_noise_never_shows_more(experiment):
    library = {name: PRESSURE_EFFECTS[name] for name in FIXED}
    assert len(library) >= 10
    sets = [set(hidden(experiment, std, library=library)) for std in STD * 4.0 ** np.arange(-4, 6)]
    assert all(less <= more for less, more in itertools.pairwise(sets))
    without_steps = {name for name in library if library[name].is_of_command and experiment is ONE_LEVEL}
    assert sets[0] == without_steps, 'without noise everything shows'
    assert sets[-1] == set(library), 'in endless noise nothing does'


def test_what_was_found_is_not_asked_for():
    found = model(GAINS, {'valve_dead_band': (300.0,)})
    quiet = recorded(heights=(1e-5,))
    assert 'valve_dead_band' not in hidden(quiet, known=found)
    assert 'lost_motion' in hidden(quiet, known=found)


def test_samples_that_do_not_count_show_nothing():
    """The second set-point, where the leak shows, is masked."""
    first = replace(TWO_LEVELS, chosen=TWO_LEVELS.sample_times < 0.6)
    assert 'leakage' in unseen(with_pressure(first, MODEL), MODEL)


@pytest.mark.parametrize('name', PRESSURE_EFFECTS)
@pytest.mark.parametrize('experiment', [ONE_LEVEL, TWO_LEVELS], ids=['one', 'two'])
def test_what_cannot_show_is_what_a_fit_without_it_makes_up_for(name, experiment):
    """The pressure of a device that has the effect, without noise, fitted by one that hasn't."""
    made = with_pressure(experiment, MODEL)
    data = {**CHANNEL.data([made], MODEL, [made.measured]), 'residual': STRENGTH * STD, 'lag': 0.0, 'setpoint_lag': 0.0}
    left = []
    for start in PRESSURE_EFFECTS[name].starts(data):
        with_it = with_pressure(experiment, model(GAINS, {name: start}))
        without, _ = find_optimum(alike([with_it]), MODEL, 1e-6, 60)
        left.append(math.sqrt(np.mean((CHANNEL.simulated([with_it], without)[0] - with_it.measured) ** 2)))
    shows = name not in hidden(experiment)
    if shows:
        assert max(left) > 0.8 * SHOWN * STD
    else:
        assert max(left) < 1.2 * SHOWN * STD


@pytest.mark.parametrize('seed', range(900, 903))
def test_the_papers_step_hides_what_the_longer_schedule_shows(seed):
    sets = {}
    for schedule in ('paper_step', 'out_and_back'):
        (experiment,) = experiments_of([recording_of(draw(None, schedule, seed))])
        found = fit_model(CHANNEL, [whole(experiment)])
        sets[schedule] = unseen(experiment, found.model)
    assert {'operating_point', 'heat_transfer', 'lost_motion'} <= set(sets['paper_step'])
    assert not {'transport_delay', 'sensor_lag', 'line_resonance', 'valve_hysteresis'} & set(sets['paper_step'])
    assert not {'leakage', 'operating_point', 'heat_transfer', 'flow_saturation'} & set(sets['out_and_back'])
