# SPDX-License-Identifier: Apache-2.0
"""Names of the files of a preview."""

PAGE_FILE = 'report.html'
PREVIEW_FILE = 'preview.json'
BAG_FILE = 'preview.mcap'
SCHEDULE_FILE = 'schedule.csv'
