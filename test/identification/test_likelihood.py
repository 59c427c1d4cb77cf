# SPDX-License-Identifier: Apache-2.0
"""What a likelihood knows of the models that it is asked about."""

import gc

import numpy as np
from drawn import CHANNEL, experiments_of, model, recording_of

from cfd_pneumatic.identification.fit.likelihood import Likelihood
from studies.panel import draw_textbook


def test_a_model_is_simulated_once_as_long_as_it_lives():
    drawn = draw_textbook('out_and_back', 700)
    likelihood = Likelihood.alike(CHANNEL, experiments_of([recording_of(drawn)]))
    one, other = model(drawn.truth.gains), model(2.0 * np.array(drawn.truth.gains))
    (first,), (second,) = likelihood.simulate(one), likelihood.simulate(other)
    assert not np.array_equal(first, second)
    assert likelihood.simulate(one)[0] is first
    (cut,) = likelihood.until('train').simulate(one)  # another likelihood
    assert cut.size < first.size
    del one
    gc.collect()
    assert len(likelihood._simulated) == 1


def test_simulations_count_as_effort():
    drawn = draw_textbook('out_and_back', 700)
    likelihood = Likelihood.alike(CHANNEL, experiments_of([recording_of(drawn)]))
    likelihood.simulate(model(drawn.truth.gains, {'leakage': (1e-10, 0.0)}))
    assert likelihood.effort.spent > 0.5 * likelihood.steps
