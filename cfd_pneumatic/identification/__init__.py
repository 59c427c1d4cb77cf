"""From recordings to parameters, and to what the model lacks: fit, uncertainty, identifiability, effects."""

from cfd_pneumatic.identification.channels.channel import Estimate
from cfd_pneumatic.identification.data.options import Options
from cfd_pneumatic.identification.fit.fit import Fit
from cfd_pneumatic.identification.identify import identify
from cfd_pneumatic.identification.result import ChannelResult, Geometry, Identification
from cfd_pneumatic.identification.verdict import PartError

__all__ = ['ChannelResult', 'Estimate', 'Fit', 'Geometry', 'Identification', 'Options', 'PartError', 'identify']
