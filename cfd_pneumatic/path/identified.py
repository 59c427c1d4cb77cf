from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from cfd_pneumatic.device import Device


class ModelError(NamedTuple):
    rest: float
    motion: float


@dataclass(frozen=True)
class IdentifiedDevice:
    device: Device
    covariances: Mapping = field(default_factory=dict)
    model_errors: Mapping[str, ModelError] = field(default_factory=dict)
    source: str = ''

    @classmethod
    def of_device(cls, device):
        return cls(device)

    @classmethod
    def load(cls, path: Path):
        path = Path(path)
        return cls(Device.load(path / 'parameters.yaml' if path.is_dir() else path))

    def deviations(self):
        return [
            ('', {name: tuple(1.02 * v for v in self.device.value(name))})
            for name in ('cylinder_a.k_x', 'cylinder_a.k_sv', 'cylinder_a.k_v', 'cylinder_b.k_x')
        ]
