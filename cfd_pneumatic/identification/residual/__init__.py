# SPDX-License-Identifier: Apache-2.0
"""The residual of a fit: its noise, its autoregression, and tests of the residual against the noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.residual.linear_prediction import (
        autocovariance,
        autoregression,
        independent_share,
        variance_of_mean,
        whitened,
    )
    from cfd_pneumatic.identification.residual.noise import (
        Noise,
        estimate_noise,
        rounding_step,
        sample_noise,
        stamp_jitter,
    )
    from cfd_pneumatic.identification.residual.normal_matrix import gram, orthonormal
    from cfd_pneumatic.identification.residual.regressors import Regressors
    from cfd_pneumatic.identification.residual.residual_features import (
        lag_after_steps,
        lag_between,
        speed_in_motion,
        strongest_frequency,
    )
    from cfd_pneumatic.identification.residual.rest_periods import runs_at_rest
    from cfd_pneumatic.identification.residual.tests import Test, is_noise, residual_tests
    from cfd_pneumatic.identification.residual.thresholds import SIGNIFICANCE
else:
    __getattr__ = loader_of(__name__)
