"""From recordings to parameters: fit, uncertainty, identifiability, report."""

from cfd_pneumatic.identification.fit import Estimate, Fit
from cfd_pneumatic.identification.identify import CylinderResult, Identification, Options, PartError, identify
from cfd_pneumatic.identification.report import make_folder, parameter_file, print_report, report_data, write_report

__all__ = [
    'CylinderResult',
    'Estimate',
    'Fit',
    'Identification',
    'Options',
    'PartError',
    'identify',
    'make_folder',
    'parameter_file',
    'print_report',
    'report_data',
    'write_report',
]
