# SPDX-License-Identifier: Apache-2.0
"""
Plan the next experiment: a schedule within the limits of a cell, and its predicted results.

::

    from cfd_pneumatic.device import Device
    from cfd_pneumatic.planning import Limits, plan

    planned = plan(Device.load('parameters.yaml'), Limits(pressures=(34e3, 69e3)))
    planned.proposal.table()   # the schedule for the robot and for rig_node.
    planned.parameters         # standard errors: Cramer-Rao bounds.
    planned.effects            # detectable strength, and similar effects
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.planning.experiment_plan import WANTED, Plan, plan
    from cfd_pneumatic.planning.limits import Limits, Sensing
    from cfd_pneumatic.planning.names import PAGE_FILE, PICTURE_FILE, PLAN_FILE, SCHEDULE_FILE
    from cfd_pneumatic.planning.planned_device import read_report, usual_pressures
    from cfd_pneumatic.planning.prediction import EffectPrediction
    from cfd_pneumatic.planning.report import FILES as PLAN_FILES
    from cfd_pneumatic.planning.report import print_plan, write_plan
    from cfd_pneumatic.planning.texts import smallest_strength_text
else:
    __getattr__ = loader_of(__name__)
