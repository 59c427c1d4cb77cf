# SPDX-License-Identifier: Apache-2.0
"""`preview.json`: the answers of a preview as strict JSON, numbers in SI units."""

from __future__ import annotations

from typing import Any

import numpy as np

from cfd_pneumatic.path.prediction import Prediction
from cfd_pneumatic.path.preview import Preview
from cfd_pneumatic.path.texts import answers

SCHEMA = 1


def preview_data(preview: Preview) -> dict[str, Any]:
    """Return a preview as JSON types."""
    path, task, feed, held = preview.constant.path, preview.task, preview.feed, preview.held
    on_path = path.is_on_path
    times = path.grid[on_path]
    along = path.along_at(times)
    return {
        'schema': SCHEMA,
        'force_n': task.force,
        'tolerance_n': task.tolerance,
        'feed_m_per_s': task.feed,
        'duration_s': path.duration,
        'answers': dict(answers(preview)),
        'notes': list(preview.notes),
        'setpoints_pa': dict(preview.levels),
        'fastest_feed_m_per_s': None if feed is None else {'predicted': feed.predicted, 'within_band': feed.with_band},
        'causes': {
            'per_speed_n_s_per_m': {
                'forward': preview.causes.per_speed.growing,
                'back': preview.causes.per_speed.shrinking,
            },
            'rms_n': {
                'gains': preview.causes.gains,
                'friction': preview.causes.friction,
                'leaks': preview.causes.leaks,
            },
        },
        'air_m3_per_s_anr': preview.air,
        'constant': _prediction_data(preview.constant),
        'held': None
        if held is None
        else {**_prediction_data(held.prediction), 'latest_arrival_s': held.latest, 'is_promised': held.is_promised},
        'time_s': times.tolist(),
        'along_m': None if along is None else along.tolist(),
        'displacement_m': path.displacement_at(times).tolist(),
    }


def _prediction_data(prediction: Prediction) -> dict[str, Any]:
    on_path = prediction.path.is_on_path
    return {
        'rms_error_n': prediction.rms_error,
        'largest_error_n': prediction.largest_error,
        'largest_error_within_band_n': prediction.largest_possible_error,
        'violations': [
            {'from_s': violation.begin, 'until_s': violation.end, 'is_certain': violation.is_certain}
            for violation in prediction.violations
        ],
        'standard_error_n': {
            cause: float(np.sqrt(np.mean(variance[on_path]))) for cause, variance in prediction.variances.items()
        },
        'force_n': prediction.force[on_path].tolist(),
        'half_band_n': prediction.half_band[on_path].tolist(),
    }
