# SPDX-License-Identifier: Apache-2.0
"""The path of a command to its regulator: dead time and lag between the commanded and the acting set pressure."""

from __future__ import annotations

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.effects import Effects
from cfd_pneumatic.rig.responses import Delay, HeldLag


class CommandPath:
    """
    The path of one cylinder's command.

    Parameters
    ----------
    rest
        Absolute set pressure that was commanded long before the first command [Pa].

    """

    def __init__(self, rest: float) -> None:
        self._last = rest
        self._faults = (0.0, 0.0)
        self._responses: list[Delay | HeldLag] = []

    def carry(self, commands: Array, period: float, effects: Effects) -> Array:
        """
        Return the acting set pressure, its mean over each period [Pa], (n,).

        Parameters
        ----------
        commands : (n,)
            Absolute set pressure that is commanded during each period [Pa].
        period
            Length of a period [s].
        effects
            Dead time and lag of the command; a change begins at rest at the last command.

        """
        faults = (effects.command_dead_time, effects.command_lag)
        if faults != self._faults:
            self._faults, self._responses = faults, _responses(effects, self._last)
        self._last = float(commands[-1])
        for response in self._responses:
            commands = response.respond(commands, period)
        return commands


def _responses(effects: Effects, rest: float) -> list[Delay | HeldLag]:
    """Return the responses of a command's path in series, at rest at a set pressure [Pa]."""
    responses: list[Delay | HeldLag] = []
    if effects.command_dead_time:
        responses.append(Delay(effects.command_dead_time, rest))
    if effects.command_lag:
        responses.append(HeldLag(effects.command_lag, rest))
    return responses
