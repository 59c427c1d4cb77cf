# SPDX-License-Identifier: Apache-2.0
"""Names of the files of results."""

from cfd_pneumatic.device import REPORT_FILE

__all__ = ['COMPARE_FILE', 'PAGE_FILE', 'PARAMETER_FILE', 'REPORT_FILE']

PARAMETER_FILE = 'parameters.yaml'
PAGE_FILE = 'report.html'
COMPARE_FILE = 'compare.mcap'
