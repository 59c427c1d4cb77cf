# SPDX-License-Identifier: Apache-2.0
"""Names of the files of a plan."""

SCHEDULE_FILE = 'schedule.csv'
PLAN_FILE = 'plan.json'
PICTURE_FILE = 'schedule.svg'
PAGE_FILE = 'plan.html'
