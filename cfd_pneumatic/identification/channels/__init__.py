# SPDX-License-Identifier: Apache-2.0
"""
Measured channels: a module for each kind.

A further channel is a module with a subclass of `Channel`, and a row in `CHANNELS`.
"""

from __future__ import annotations

from collections.abc import Sequence

from cfd_pneumatic.identification.channels.channel import (
    NOT_ESTIMATED,
    Channel,
    Curve,
    Effects,
    Estimate,
    Model,
    Quantity,
)
from cfd_pneumatic.identification.channels.characteristics import PLACES, VARIABLES
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.channels.unknown import Unknown
from cfd_pneumatic.identification.data import Options
from cfd_pneumatic.recording import Recording

CHANNELS: list[type[Channel]] = [Pressure, Force]
"""Kinds of channels, in the order of results."""


def channels_of(recordings: Sequence[Recording], options: Options) -> list[Channel]:
    """Return the channels that recordings hold, in the order of `CHANNELS`."""
    return [channel for kind in CHANNELS for channel in kind.found_in(recordings, options)]
