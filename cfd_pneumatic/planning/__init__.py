# SPDX-License-Identifier: Apache-2.0
"""
Which experiment to do next: a schedule within the limits of a cell, and what it will tell.

::

    from cfd_pneumatic.device import Device
    from cfd_pneumatic.planning import Limits, plan

    found = plan(Device.load('parameters.yaml'), Limits(pressures=(34e3, 69e3)))
    found.proposal.table()   # for the robot, and for rig_node
    found.parameters         # with their Cramer-Rao bounds
    found.effects            # whether each would show, from which strength on, and what it could be mistaken for
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.planning.experiment_plan import WANTED, Plan, plan
    from cfd_pneumatic.planning.limits import Limits, Sensing
    from cfd_pneumatic.planning.names import PICTURE_FILE, PLAN_FILE, SCHEDULE_FILE
    from cfd_pneumatic.planning.planned_device import read_report, usual_pressures
    from cfd_pneumatic.planning.prediction import EffectPrediction
    from cfd_pneumatic.planning.report import FILES as PLAN_FILES
    from cfd_pneumatic.planning.report import print_plan, smallest_words, write_plan
else:
    __getattr__ = loader_of(__name__)
