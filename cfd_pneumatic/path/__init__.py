# SPDX-License-Identifier: Apache-2.0
"""Predict the contact force along a path, and the set-points that hold it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.path.band import PlanErrors
    from cfd_pneumatic.path.console import print_preview
    from cfd_pneumatic.path.files import FILES as PREVIEW_FILES
    from cfd_pneumatic.path.files import schedule_text
    from cfd_pneumatic.path.hold import Regulators, held_setpoints
    from cfd_pneumatic.path.identified import IdentifiedDevice
    from cfd_pneumatic.path.inputs import read_path
    from cfd_pneumatic.path.motion import PathMotion, Surface
    from cfd_pneumatic.path.names import BAG_FILE, PAGE_FILE, PREVIEW_FILE, SCHEDULE_FILE
    from cfd_pneumatic.path.prediction import Prediction
    from cfd_pneumatic.path.preview import Preview, Task, preview_force
    from cfd_pneumatic.path.result import ForceOnPath, force_on_path
    from cfd_pneumatic.path.setpoints import SetpointRange
    from cfd_pneumatic.path.simulation import PathSimulator
else:
    __getattr__ = loader_of(__name__)
