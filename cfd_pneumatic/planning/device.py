"""The device to plan for, as a parameter file describes it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CONTACT_FORCE, CYLINDERS, PISTON_AREA
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import NAMES, TABLE_1, OperatingPoints
from cfd_pneumatic.model.effects import FORCE_EFFECTS, PRESSURE_EFFECTS, Effect
from cfd_pneumatic.planning.limits import Sensing
from cfd_pneumatic.units import PSI
from cfd_pneumatic.yaml_files import read_yaml

Array = NDArray[np.float64]
Effects = Mapping[str, tuple[float, ...]]
"""Parameters of each effect that is on, by its name."""

_RANGE = 5.0 * PSI  # above a single set-point, where the file has no other [Pa]


@dataclass(frozen=True)
class PlannedCylinder:
    """
    One cylinder.

    Attributes
    ----------
    points
        Gains over the gauge set-point.
    home
        Gauge set-point that it usually has [Pa].
    effects
        Those that are on.

    """

    points: OperatingPoints
    home: float
    effects: Effects

    @property
    def gains(self) -> Array:
        """At home, in the order of `SPECS`, shape (gains,) [SI]."""
        return self.points.at(self.home).table[0, 1:]


@dataclass(frozen=True)
class PlannedDevice:
    """
    The device.

    Attributes
    ----------
    cylinders
        By their names.
    ambient_pressure
        What gauge pressures are counted from [Pa].
    area
        Of the piston [m^2].
    factor
        Contact force over piston force, from the linkage [-].
    force_effects
        Effects on the force that are on.
    assumed
        What the file does not say and was taken from the paper's Table 1: parameters by their full names.

    """

    cylinders: Mapping[str, PlannedCylinder]
    ambient_pressure: float
    area: float
    factor: float
    force_effects: Effects
    assumed: tuple[str, ...]

    @property
    def homes(self) -> tuple[float, float]:
        """Gauge set-points of the cylinders A and B that they usually have; a missing one's is the other's [Pa]."""
        present = next(iter(self.cylinders.values())).home
        first, second = (self.cylinders[name].home if name in self.cylinders else present for name in CYLINDERS)
        return first, second

    @property
    def usual_pressures(self) -> tuple[float, float]:
        """Range of the set-points in the file, 5 psi from the only one on where there is no other, gauge [Pa]."""
        points = np.concatenate([[one.home, *one.points.setpoints] for one in self.cylinders.values()])
        low, high = float(points.min()), float(points.max())
        return low, high if high > low else low + _RANGE

    def within(self, pressures: tuple[float, float]) -> PlannedDevice:
        """Return it with homes within a range of gauge pressures [Pa]."""
        low, high = pressures
        cylinders = {name: replace(one, home=min(max(one.home, low), high)) for name, one in self.cylinders.items()}
        return replace(self, cylinders=cylinders)


def read_device(path: Path) -> PlannedDevice:
    """
    Return the device that a parameter file of `sim_node` describes, as `identify_bag` writes it.

    Raises
    ------
    InputError
        If the file can't be read, describes no cylinder, or a value is none that the model takes.

    """
    entries = _Entries(path, _flat(_ros_parameters(read_yaml(path))))
    present = [name for name in CYLINDERS if entries.below(name) and entries.enabled(f'{name}.enabled', True)]
    if not present:
        raise InputError(
            f'{path} describes neither cylinder_a nor cylinder_b: give a parameters.yaml as identify_bag writes it'
        )
    assumed: list[str] = []
    cylinders = {name: _cylinder(entries, name, assumed) for name in present}
    return PlannedDevice(
        cylinders=cylinders,
        ambient_pressure=entries.number('ambient_pressure', AMBIENT_PRESSURE),
        area=entries.number('area', PISTON_AREA),
        factor=entries.number('geometric_factor', 1.0),
        force_effects=_effects(entries, CONTACT_FORCE, FORCE_EFFECTS),
        assumed=tuple(assumed),
    )


def read_sensing(path: Path, sensing: Sensing) -> Sensing:
    """
    Return what sensors see with the noise that a report of `identify_bag` found.

    Raises
    ------
    InputError
        If the file is no such report.

    """
    try:
        report = json.loads(path.read_text(encoding='utf-8'))
        cylinders = report['cylinders'].values()
        noise = max(float(one['noise_floor_pa']) for one in cylinders)
        rates = [float(one['displacement_samples']) / float(one['duration_s']) for one in report['recordings']]
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}; give the report.json of identify_bag') from error
    except (ValueError, LookupError, TypeError, AttributeError, ZeroDivisionError) as error:
        raise InputError(f'{path} is no report of identify_bag: give its report.json') from error
    # the floor is that of the residual: what the displacement's noise adds to it is in there
    return replace(sensing, pressure_noise=noise, displacement_noise=0.0, sample_rate=float(round(min(rates))))


class _Entries:
    """A file's parameters by their dotted names."""

    def __init__(self, path: Path, values: Mapping[str, Any]) -> None:
        self.path = path
        self.values = values

    def below(self, prefix: str) -> bool:
        return any(name.startswith(f'{prefix}.') for name in self.values)

    def enabled(self, name: str, default: bool) -> bool:
        value = self.values.get(name, default)
        if not isinstance(value, bool):
            raise InputError(f'{self.path}: {name} is {value!r}: give true or false')
        return value

    def number(self, name: str, default: float) -> float:
        value = self.values.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f'{self.path}: {name} is {value!r}: give a number')
        return float(value)

    def numbers(self, name: str) -> Array | None:
        if name not in self.values:
            return None
        try:
            found = np.asarray(self.values[name], dtype=np.float64)
        except (TypeError, ValueError):
            found = np.empty(0)
        if found.ndim != 1 or not found.size or not np.all(np.isfinite(found)):
            raise InputError(f'{self.path}: {name} is {self.values[name]!r}: give a list of numbers')
        return found


def _ros_parameters(document: Any) -> dict[str, Any]:
    """Return what stands below `ros__parameters`, whatever the node is called."""
    found: dict[str, Any] = {}
    if isinstance(document, dict):
        for name, below in document.items():
            found |= below if name == 'ros__parameters' and isinstance(below, dict) else _ros_parameters(below)
    return found


def _flat(values: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _flat(value, f'{prefix}{name}.')
        else:
            flat[f'{prefix}{name}'] = value
    return flat


def _cylinder(entries: _Entries, name: str, assumed: list[str]) -> PlannedCylinder:
    setpoints = entries.numbers(f'{name}.setpoints')
    setpoints = TABLE_1.setpoints if setpoints is None else setpoints
    given = {gain: entries.numbers(f'{name}.{gain}') for gain in NAMES}
    assumed += [f'{name}.{gain}' for gain, values in given.items() if values is None]
    try:
        usual = TABLE_1.at(setpoints)
        rows = {gain: getattr(usual, gain) if values is None else values for gain, values in given.items()}
        rows['setpoints'] = setpoints
        points = OperatingPoints.from_rows(rows)
    except ValueError as error:
        raise InputError(f'{entries.path}: {name}.{error}') from error
    home = entries.number(f'{name}.initial_setpoint', float(setpoints[0]))
    return PlannedCylinder(points, home, _effects(entries, name, PRESSURE_EFFECTS))


def _effects(entries: _Entries, prefix: str, library: Mapping[str, Effect]) -> Effects:
    found = {}
    for name, effect in library.items():
        if entries.enabled(f'{prefix}.{name}.enabled', False):
            values = []
            for parameter in effect.parameters:
                value = entries.number(f'{prefix}.{name}.{parameter.name}', parameter.null)
                if not parameter.lower <= value <= parameter.upper:
                    raise InputError(
                        f'{entries.path}: {prefix}.{name}.{parameter.name} = {value:g} is outside {parameter.lower:g} '
                        f'to {parameter.upper:g} {parameter.unit}'
                    )
                values.append(value)
            found[name] = tuple(values)
    return found
