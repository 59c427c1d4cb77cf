# SPDX-License-Identifier: Apache-2.0
"""Search for what a model lacks: core, effects, unknown curve; and effects that the recordings cannot show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.search.candidates import Candidates
    from cfd_pneumatic.identification.search.complement import Complement
    from cfd_pneumatic.identification.search.curve_fit import fit_curve, height_indices, penalty_matrix
    from cfd_pneumatic.identification.search.curve_places import CurvePlace
    from cfd_pneumatic.identification.search.curve_search import FittedCurve
    from cfd_pneumatic.identification.search.final_fit import with_core
    from cfd_pneumatic.identification.search.stepwise import Trial
    from cfd_pneumatic.identification.search.strategy import Strategy
    from cfd_pneumatic.identification.search.thresholds import SHOWN, STRENGTH, TIE
    from cfd_pneumatic.identification.search.visible_effects import effects_not_visible
else:
    __getattr__ = loader_of(__name__)
