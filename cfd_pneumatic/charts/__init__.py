# SPDX-License-Identifier: Apache-2.0
"""Charts of a page: described once, written as a static picture and as data for the interactive plots."""

from __future__ import annotations

from cfd_pneumatic.charts.chart import Chart, Curve, Panel, Style, Window
from cfd_pneumatic.charts.element import SCRIPT_FILE, chart_element, is_script_file, plot_scripts, shared_scripts
from cfd_pneumatic.charts.svg import svg
from cfd_pneumatic.charts.thinning import thinned
