"""From recordings to parameters, and to what the model lacks: fit, uncertainty, identifiability, effects."""

from cfd_pneumatic.identification.fit.output_error import Estimate, Fit
from cfd_pneumatic.identification.identify import CylinderResult, Geometry, Identification, Options, identify
from cfd_pneumatic.identification.verdict import PartError

__all__ = [
    'CylinderResult',
    'Estimate',
    'Fit',
    'Geometry',
    'Identification',
    'Options',
    'PartError',
    'identify',
]
