# SPDX-License-Identifier: Apache-2.0
"""Where the measured recordings are, and the skip where they are not."""

import os
from pathlib import Path

import pytest

_BESIDE = Path(__file__).parents[2] / 'shared' / 'data'
ROOT = Path(os.environ.get('CFD_PNEUMATIC_DATA') or _BESIDE) / 'pneumatic_actuator'
MAPPING = Path(__file__).parents[1] / 'config' / 'pneumatic_actuator.yaml'
DECAYS = MAPPING.with_name('pressure_decay.yaml')

needs_measured_data = pytest.mark.skipif(
    not ROOT.is_dir(), reason='the measured recordings are neither in ../shared/data nor in CFD_PNEUMATIC_DATA'
)
