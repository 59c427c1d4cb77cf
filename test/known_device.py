# SPDX-License-Identifier: Apache-2.0
"""A device with known parameters, a surface, and the rig's device that it was identified from."""

from __future__ import annotations

from functools import cache

import numpy as np

from cfd_pneumatic.device import Device
from cfd_pneumatic.path import Surface
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import Schedule, SetPoints, device_named, lay_out, record
from cfd_pneumatic.units import PSI

AREA = 1.14e-3
KNOWN = Device(
    {
        'area': AREA,
        'cylinder_a.setpoints': (0.0,),
        'cylinder_a.k_x': (6e6,),
        'cylinder_a.k_sv': (150.0,),
        'cylinder_a.k_v': (30.0,),
        'cylinder_a.tau': (0.01,),
        'cylinder_b.setpoints': (0.0,),
        'cylinder_b.k_x': (5e6,),
        'cylinder_b.k_sv': (140.0,),
        'cylinder_b.k_v': (28.0,),
        'cylinder_b.tau': (0.01,),
    }
)
"""Two cylinders with different branches."""


def surface(seed: int = 0, length: float = 0.2) -> Surface:
    """Return a random smooth surface with an error of about 0.3 mm."""
    random = np.random.default_rng(seed)
    along = np.linspace(0.0, length, 201)
    waves = zip(random.uniform(0.03, 0.15, 4), random.uniform(0.0, 2.0 * np.pi, 4))
    error = sum(1.5e-4 * np.sin(2.0 * np.pi * along / wave + phase) for wave, phase in waves)
    return Surface(along, np.asarray(error))


@cache
def identified_folder(root: str) -> None:
    """Write the results of an identification of the rig's device `paper` into a folder."""
    from cfd_pneumatic import identify

    identify(recording_of(record(_strokes(), device_named('paper'), seed=3))).save(root)


def _strokes() -> Schedule:
    """Return strokes of 2 mm at two set-points of each cylinder."""

    def motion(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turn = 2.0 * np.pi * 0.7
        start = np.minimum(times, 1.0)
        return 1e-3 * start**2 * np.sin(turn * times), 1e-3 * (
            start**2 * turn * np.cos(turn * times) + np.where(times < 1.0, 2.0 * times, 0.0) * np.sin(turn * times)
        )

    levels = [
        SetPoints(0.0, 10.0 * PSI, 7.0 * PSI),
        SetPoints(7.0, 12.0 * PSI, 6.0 * PSI),
        SetPoints(14.0, 9.0 * PSI, 8.0 * PSI),
    ]
    return lay_out('strokes', motion, levels, 10_000, 2e-3)
