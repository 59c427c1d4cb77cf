"""
Which experiment to do next: a schedule within the limits of a cell, and what it will tell.

::

    from cfd_pneumatic.planning import Limits, Sensing, plan, read_device

    found = plan(read_device(Path('parameters.yaml')), Limits(pressures=(34e3, 69e3)), Sensing())
    found.proposal.table()   # for the robot, and for rig_node
    found.parameters         # with their Cramer-Rao bounds
    found.effects            # whether each would show, from which strength on, and what it could be mistaken for
"""

from cfd_pneumatic.planning.device import PlannedDevice, read_device, read_sensing
from cfd_pneumatic.planning.limits import Limits, Sensing
from cfd_pneumatic.planning.plan import WANTED, EffectPrediction, ParameterPrediction, Plan, plan, predict
from cfd_pneumatic.planning.proposal import Proposal

__all__ = [
    'WANTED',
    'EffectPrediction',
    'Limits',
    'ParameterPrediction',
    'Plan',
    'PlannedDevice',
    'Proposal',
    'Sensing',
    'plan',
    'predict',
    'read_device',
    'read_sensing',
]
