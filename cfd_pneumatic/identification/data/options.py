"""How to identify."""

from __future__ import annotations

from dataclasses import dataclass

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.identification.data.split import FRACTIONS


@dataclass(frozen=True)
class Options:
    """
    How to identify.

    Attributes
    ----------
    per_setpoint
        Fit an operating-point table, one row for each set-point, beside the joint fit.
    fractions
        Shares of train, validation and test.
    ambient_pressure
        What gauge pressures are counted from [Pa].
    close_loop
        Search for physical effects that the model lacks, in the force too where it was recorded.
    area
        About how large either piston is [m^2]; None if nobody knows.
    geometric_factor
        Contact force over piston force, from the linkage [-]; None if nobody knows: then it is in the area.

    """

    per_setpoint: bool = False
    fractions: tuple[float, float, float] = FRACTIONS
    ambient_pressure: float = AMBIENT_PRESSURE
    close_loop: bool = False
    area: float | None = None
    geometric_factor: float | None = None
