"""The rig without a graph follows a surface, for as long as one likes."""

from __future__ import annotations

from cfd_pneumatic.rig import Performance, RigParameters, surface_following

EPOCH = 1_700_000_000_000_000_000


def surfaces(rig: RigParameters, seed: int, duration: float = 60.0) -> Performance:
    """Return a rig that follows a random surface, over and over."""
    schedule = surface_following(duration=duration, seed=seed).with_return()
    return Performance(schedule, rig, seed=seed, repeat=True)
