# SPDX-License-Identifier: Apache-2.0
"""Prepare recordings for a fit: sampling times, smoothed motion, train, validation and test parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.data.effort import Effort
    from cfd_pneumatic.identification.data.experiment import Block, Experiment, rests_at_start, shortest_period
    from cfd_pneumatic.identification.data.motion import Motion, exact_motion, observed_motion, smooth_motion
    from cfd_pneumatic.identification.data.options import AUTO, CORES, FRACTIONS, LINEAR, PHYSICAL, Options
    from cfd_pneumatic.identification.data.split import PARTS, Split, split_recordings, stroke_times
    from cfd_pneumatic.identification.data.thresholds import FEWEST_SAMPLES, SMALLEST_FRACTION
    from cfd_pneumatic.identification.data.tolerance import Tolerance, tolerance_from, tolerated
    from cfd_pneumatic.identification.data.turning_points import reversals, seal_displacement
    from cfd_pneumatic.identification.data.value_range import check_range
else:
    __getattr__ = loader_of(__name__)
