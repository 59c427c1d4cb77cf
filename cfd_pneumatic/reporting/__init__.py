# SPDX-License-Identifier: Apache-2.0
"""What an identification says: data for programs, a parameter file, a page and tables for people, a bag for plots."""

from cfd_pneumatic.reporting.advice import next_plan
from cfd_pneumatic.reporting.console import print_report
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.reporting.draft import draft_effect
from cfd_pneumatic.reporting.folder import compare_files, is_compare_file, write_report
from cfd_pneumatic.reporting.names import PAGE_FILE, PARAMETER_FILE, REPORT_FILE

__all__ = [
    'PAGE_FILE',
    'PARAMETER_FILE',
    'REPORT_FILE',
    'compare_files',
    'draft_effect',
    'is_compare_file',
    'next_plan',
    'print_report',
    'report_data',
    'write_report',
]
