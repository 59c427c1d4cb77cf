# SPDX-License-Identifier: Apache-2.0
"""Fit a model to recordings, and estimate the uncertainty of its parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.fit.data_sheets import as_data_sheets
    from cfd_pneumatic.identification.fit.fit import AT_BOUND, Fit, Optimum, find_optimum, fit_model, summary
    from cfd_pneumatic.identification.fit.levenberg import Quadratic, least_squares
    from cfd_pneumatic.identification.fit.likelihood import Likelihood, Unknowns
    from cfd_pneumatic.identification.fit.thresholds import CONFIDENCE, LARGEST_RELATIVE_STD
    from cfd_pneumatic.identification.fit.uncertainty import Covariance, Information, information
else:
    __getattr__ = loader_of(__name__)
