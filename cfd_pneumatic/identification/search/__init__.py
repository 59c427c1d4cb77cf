# SPDX-License-Identifier: Apache-2.0
"""Which effects a model lacks: stepwise regression, and which effects could not have shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.search.candidates import Candidates
    from cfd_pneumatic.identification.search.complement import Complement
    from cfd_pneumatic.identification.search.curves import fitted, heights_of, penalty_of
    from cfd_pneumatic.identification.search.final_fit import with_core
    from cfd_pneumatic.identification.search.laws import Drawn
    from cfd_pneumatic.identification.search.slots import Slot
    from cfd_pneumatic.identification.search.stepwise import Trial
    from cfd_pneumatic.identification.search.strategy import Strategy
    from cfd_pneumatic.identification.search.thresholds import SHOWN, STRENGTH, TIE
    from cfd_pneumatic.identification.search.visibility import invisible
else:
    __getattr__ = loader_of(__name__)
