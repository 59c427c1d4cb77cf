# SPDX-License-Identifier: Apache-2.0
"""Reports of an identification: JSON data, parameter file, HTML page, console tables, and a bag for plots."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.reporting.advice import next_plan
    from cfd_pneumatic.reporting.comparison import MEASURED, RESIDUAL, SIMULATED
    from cfd_pneumatic.reporting.console import print_report, print_summary
    from cfd_pneumatic.reporting.data import report_data
    from cfd_pneumatic.reporting.draft import draft_effect
    from cfd_pneumatic.reporting.folder import FILES as REPORT_FILES
    from cfd_pneumatic.reporting.folder import compare_files, file_names, is_compare_file, write_report
    from cfd_pneumatic.reporting.leak_report import FILES as LEAK_FILES
    from cfd_pneumatic.reporting.leak_report import print_decay, write_decays
    from cfd_pneumatic.reporting.names import PAGE_FILE, PARAMETER_FILE, REPORT_FILE
    from cfd_pneumatic.reporting.overview_plot import overview
    from cfd_pneumatic.reporting.page import report_page
    from cfd_pneumatic.reporting.template import is_page, rendered
else:
    __getattr__ = loader_of(__name__)
