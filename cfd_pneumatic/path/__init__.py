# SPDX-License-Identifier: Apache-2.0
"""
Predict the contact force along a path.

`read_path` reads the path of the piston from a table or a bag.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.path.inputs import read_path
    from cfd_pneumatic.path.motion import PathMotion, Surface
else:
    __getattr__ = loader_of(__name__)
