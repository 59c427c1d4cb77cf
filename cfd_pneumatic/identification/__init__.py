# SPDX-License-Identifier: Apache-2.0
"""
From recordings to parameters, and to what the model lacks: fit, uncertainty, identifiability, effects.

A name is loaded when it is first asked for: a monitor needs the noise's formulas long before it needs a fit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.changes import Change, DeviceState, Drift
    from cfd_pneumatic.identification.channels import PLACES, VARIABLES, Channel, Estimate, Force, Model, Pressure
    from cfd_pneumatic.identification.characteristic import Characteristic
    from cfd_pneumatic.identification.conclusion import Conclusion, PartError, ratio_without_rests
    from cfd_pneumatic.identification.data import (
        AUTO,
        CORES,
        FRACTIONS,
        PARTS,
        SMALLEST_FRACTION,
        Experiment,
        Motion,
        Options,
        Split,
        exact_motion,
        rests_at_start,
        smooth_motion,
        split_recordings,
        stroke_times,
        tolerance_from,
    )
    from cfd_pneumatic.identification.decay import LAWS, Decay, Leak, decay_of, rate_of
    from cfd_pneumatic.identification.fit import (
        LARGEST_RELATIVE_STD,
        Covariance,
        Fit,
        Information,
        Likelihood,
        find_optimum,
        fit_model,
    )
    from cfd_pneumatic.identification.input_checks import check_recording, check_recordings, describe
    from cfd_pneumatic.identification.loop import close_loop
    from cfd_pneumatic.identification.model_error import ModelError, error_beyond_noise
    from cfd_pneumatic.identification.preparation import prepare_recordings
    from cfd_pneumatic.identification.procedure import identify
    from cfd_pneumatic.identification.report_texts import (
        number,
        percent,
        readable_name,
        reservation,
        sentence,
        title,
        title_of_test,
        uncertainty,
        unit,
        verdict,
    )
    from cfd_pneumatic.identification.residual import (
        SIGNIFICANCE,
        Test,
        autocovariance,
        autoregression,
        is_noise,
        rounding_step,
        sample_noise,
        whitened,
    )
    from cfd_pneumatic.identification.residual_dependence import (
        Dependence,
        describe_remaining_error,
        residual_dependences,
        signal_dependences,
    )
    from cfd_pneumatic.identification.result import ChannelResult, Comparison, Geometry, Identification
    from cfd_pneumatic.identification.search import SHOWN, STRENGTH, TIE, Complement, Trial, with_core
    from cfd_pneumatic.identification.thresholds import STEP_SETTLING_TIME
    from cfd_pneumatic.identification.visited_range import Outside
else:
    __getattr__ = loader_of(__name__)
