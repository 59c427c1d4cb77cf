# SPDX-License-Identifier: Apache-2.0
"""Predict the contact force of an identified device along a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.path.identified import IdentifiedDevice
else:
    __getattr__ = loader_of(__name__)
