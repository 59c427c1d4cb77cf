# SPDX-License-Identifier: Apache-2.0
"""Define a device of one or two cylinders, with or without effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cfd_pneumatic.arguments import check_number, check_path, check_switches, check_type
from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.device import file
from cfd_pneumatic.device.descriptors import DESCRIPTORS, Value
from cfd_pneumatic.device.identified_range import UNKNOWN, IdentifiedRange, Span
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import check_replaceable, write_text
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model import (
    FORCE_PARTS,
    NAMES,
    PRESSURE_PARTS,
    TABLE_1,
    Cylinder,
    DeviceModel,
    Effect,
    ForceGeometry,
    OperatingPoints,
)
from cfd_pneumatic.recording import Recording

if TYPE_CHECKING:
    from cfd_pneumatic.path import ForceOnPath, PathMotion, Surface

_LEAST_SETPOINT = 100.0
"""Gauge set-point below which no regulator works [Pa]: a smaller number is in bar or psi."""


@dataclass(frozen=True, repr=False)
class Device:
    """
    A device, described by its parameters.

    Attributes
    ----------
    given
        Parameters by name in `DESCRIPTORS`; the others have their defaults [SI].
    notes
        Comments in the parameter file by name of the parameter, for people.
    source
        The parameter file of the device; None if the device is from no file, or was changed.

    Raises
    ------
    InputError
        If the model refuses a value.

    """

    given: Mapping[str, Value]
    notes: Mapping[str, str] = field(default_factory=dict, compare=False)
    source: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check every value."""
        check_type('given', self.given, Mapping, 'a dictionary of parameters')
        object.__setattr__(self, 'given', {name: _checked(name, value) for name, value in self.given.items()})
        _ = self.model, self.identified_range

    def __repr__(self) -> str:
        """Return the names of the cylinders and the effects."""
        effects = {name: cylinder.effects for name, cylinder in self.model.cylinders.items()}
        effects['force'] = self.model.force_effects
        parts = [f'{name} with {", ".join(names)}' if names else name for name, names in effects.items()]
        return f'<Device: {"; ".join(parts)}>'

    def __str__(self) -> str:
        """Return the text of the parameter file."""
        return self.text

    @classmethod
    def load(cls, path: Path | str) -> Device:
        """
        Return the device of a ROS parameter file, as `identify_bag` and `save` write it.

        Raises
        ------
        InputError
            If the file cannot be read or describes no cylinder, or the model refuses a value.

        """
        check_path('path', path)
        path = Path(path)
        given = file.read(path)
        if not any(name.startswith(f'{cylinder}.') for name in given for cylinder in CYLINDERS):
            raise InputError(
                f'{path} describes neither cylinder_a nor cylinder_b: give a parameters.yaml of identify_bag'
            )
        try:
            return cls(given, source=path)
        except InputError as error:
            raise InputError(f'{path}: {error}') from error

    def save(self, path: Path | str, *, overwrite: bool = False) -> None:
        """
        Write the ROS parameter file with which `sim_node` and `monitor_node` run.

        Parameters
        ----------
        path
            Path of the file. A file that `save` or `identify_bag` wrote earlier is replaced.
        overwrite
            Whether any other file is replaced, too.

        Raises
        ------
        InputError
            If the file cannot be written, or an existing file must not be replaced.

        """
        check_path('path', path)
        check_switches(overwrite=overwrite)
        check_replaceable(Path(path), file.is_parameter_file, overwrite=overwrite)
        write_text(Path(path), file.saved_text(self.text))

    @property
    def text(self) -> str:
        """Text of the parameter file."""
        return file.text_of(self.given, self.notes)

    def value(self, name: str) -> Value:
        """Return a parameter, or its default [SI]; a gain's default is Table 1's at the set-points."""
        return self.given[name] if name in self.given else default_of(name, self.given)

    def number(self, name: str) -> float:
        """Return a parameter that is a number [SI]."""
        value = self.value(name)
        assert isinstance(value, float)
        return value

    def with_values(self, values: Mapping[str, Value]) -> Device:
        """Return the device with changed parameters."""
        return replace(self, given={**self.given, **values}, source=None)

    @lazy_property
    def model(self) -> DeviceModel:
        """The model that simulates the device."""
        ambient = self.number('ambient_pressure')
        a, b = (self._cylinder(name, ambient) for name in CYLINDERS)
        if a is None and b is None:
            raise InputError('cylinder_a.enabled and cylinder_b.enabled are both false: leave one of them true')
        geometry = ForceGeometry(self.number('area'), self.number('geometric_factor'), ambient)
        if geometry.geometric_factor == 0.0:
            raise InputError('geometric_factor is 0: no force could be set or derived')
        force_effects = self._effects(CONTACT_FORCE, FORCE_PARTS)
        return DeviceModel(a, b, geometry, force_effects, self.number(f'{CONTACT_FORCE}.seal_play'))

    @property
    def initial_setpoints(self) -> dict[str, float]:
        """Gauge set-point of each cylinder until the first set-point arrives [Pa]."""
        return {name: self.number(f'{name}.initial_setpoint') for name in self.model.cylinders}

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the gains and the area that are not given: gains from Table 1, and the default area."""
        names = ['area', *(f'{cylinder}.{gain}' for cylinder in self.model.cylinders for gain in NAMES)]
        return tuple(name for name in names if name not in self.given)

    @property
    def not_identifiable(self) -> tuple[str, ...]:
        """Names of the gains that are not identifiable and have the values assumed in the fit."""
        names = []
        for cylinder in self.model.cylinders:
            gains = self.value(f'{cylinder}.not_identifiable')
            assert isinstance(gains, tuple)
            names += [f'{cylinder}.{gain}' for gain in gains if gain]
        return tuple(names)

    @property
    def identified_range(self) -> IdentifiedRange:
        """Range of the recordings with which the device was identified."""
        names = tuple(self.model.cylinders)
        return IdentifiedRange(
            self._span('identified_displacement'),
            self.number('identified_speed') or None,
            {name: span for name in names if (span := self._span(f'{name}.identified_setpoints'))},
            {name: span for name in names if (span := self._span(f'{name}.identified_pressures'))},
        )

    def _span(self, name: str) -> Span | None:
        value = self.value(name)
        assert isinstance(value, tuple)
        if len(value) != 2 or not all(isinstance(end, float) and math.isfinite(end) for end in value):
            raise InputError(f'{name}: give two finite numbers, the lower first')
        low, high = float(value[0]), float(value[1])
        if low > high:
            raise InputError(f'{name}: {low:g} is above {high:g}: give the lower first')
        return None if (low, high) == UNKNOWN else (low, high)

    def simulate(
        self,
        recording: Recording,
        *,
        setpoints: Mapping[str, float] | None = None,
        raw: bool = False,
        measured_pressures: bool = False,
    ) -> Recording:
        """
        Simulate pressures and force from a recording's displacement and set-points.

        Displacement and stamps are smoothed as in `identify`. The simulated samples have the times of the measured
        pressures and force, from the first to the last sample of the displacement.

        Parameters
        ----------
        recording
            The recording. Its pressures are used only as initial values if the piston moves at the begin.
        setpoints
            Constant gauge set-points by cylinder, instead of the recorded set-points; 0, or 100 Pa or more above or
            below ambient [Pa]. By default `initial_setpoints` if no set-point was recorded.
        raw
            Whether to simulate sample by sample without smoothing, as `sim_node` does.
        measured_pressures
            Whether to compute the force from the recorded pressures, as in the report, instead of the simulated.

        Returns
        -------
        Recording
            Simulated pressures and force, the set-points of the simulation, and the recorded displacement.

        Raises
        ------
        InputError
            If `recording` is not a recording, is too short or lacks the measured pressures. Also if a set-point is of
            no cylinder, or cannot be in pascals.

        """
        if not isinstance(recording, Recording):
            raise InputError(f'simulate needs a recording, not {type(recording).__name__}: read the recording first')
        check_switches(raw=raw, measured_pressures=measured_pressures)
        from cfd_pneumatic.device import simulation  # loads SciPy and the smoother, which no node needs

        constant = self.constant_setpoints(recording, self._checked_setpoints(setpoints))
        if raw:
            return simulation.simulate_live(self.model, recording, constant)
        return simulation.simulate_smoothed(self.model, recording, constant, measured_pressures)

    def force_on_path(
        self,
        path: Surface | PathMotion | Path | str,
        *,
        force: float,
        feed: float | None = None,
        tolerance: float | None = None,
        scan_error: float = 0.0,
        timing_error: float = 0.0,
        hold: bool = False,
        **options: Any,
    ) -> ForceOnPath:
        """
        Predict the contact force along a path, and optionally the set-points that hold it.

        A device that was loaded from the folder of `identify_bag` has the uncertainty of its identification in the
        band; of a result use `Result.force_on_path`.

        Parameters
        ----------
        path
            Error of a surface, motion of the piston over time, or a file with one of them.
        force
            Wanted contact force [N].
        feed
            Speed along a surface [m/s].
        tolerance
            Largest accepted force error [N].
        scan_error
            Standard deviation of the error of the surface [m].
        timing_error
            Standard deviation of the time at which the robot is at a position [s].
        hold
            Whether to compute set-points over time that hold the force.
        **options
            Further options of `cfd_pneumatic.path.force_on_path`: `bias`, `start`, `rate`, `slew`, `limits`.

        Raises
        ------
        InputError
            If an argument is invalid, the path cannot be read or is outside of the stroke, or the regulators cannot
            give the force.

        """
        from cfd_pneumatic.path import IdentifiedDevice, force_on_path  # the layer above, for the user's convenience

        return force_on_path(
            IdentifiedDevice.of_device(self),
            path,
            force=force,
            feed=feed,
            tolerance=tolerance,
            scan_error=scan_error,
            timing_error=timing_error,
            hold=hold,
            **options,
        )

    def constant_setpoints(self, recording: Recording, chosen: Mapping[str, float]) -> dict[str, float]:
        """Return the chosen gauge set-points, and the initial ones of cylinders without a recorded set-point [Pa]."""
        missing = {
            name: level
            for name, level in self.initial_setpoints.items()
            if name not in recording.cylinders or recording.cylinders[name].setpoint is None
        }
        return {**missing, **chosen}

    def _checked_setpoints(self, setpoints: Mapping[str, float] | None) -> dict[str, float]:
        """Return gauge set-points by cylinder [Pa]; refuse values that cannot be pascals."""
        if setpoints is None:
            return {}
        check_type('setpoints', setpoints, Mapping, 'a dictionary such as setpoints={"cylinder_a": 3e5}')
        for name, level in setpoints.items():
            if name not in self.model.cylinders:
                cylinders = ', '.join(self.model.cylinders)
                raise InputError(f'there is no {name} for a set-point: the cylinders are {cylinders}')
            check_number(f'the set-point of {name}', level)
            if not math.isfinite(level) or 0.0 < abs(level) < _LEAST_SETPOINT:
                raise InputError(f'the set-point of {name} is {level:g} Pa: give pascals above ambient, 3e5 for 3 bar')
        return dict(setpoints)

    def _cylinder(self, name: str, ambient: float) -> Cylinder | None:
        if not self.value(f'{name}.enabled'):
            return None
        try:
            points = OperatingPoints.from_rows({row: self.value(f'{name}.{row}') for row in ('setpoints', *NAMES)})
        except ValueError as error:
            raise InputError(f'{name}.{error}') from error
        effects = self._effects(name, PRESSURE_PARTS)
        return Cylinder(points, ambient, effects, self.number(f'{name}.setpoint_offset'))

    def _effects(self, prefix: str, library: Mapping[str, Effect]) -> dict[str, tuple[float, ...]]:
        """Return the parameters of each enabled effect."""
        return {
            name: tuple(self.number(f'{prefix}.{name}.{parameter.name}') for parameter in effect.parameters)
            for name, effect in library.items()
            if self.value(f'{prefix}.{name}.enabled')
        }


def default_of(name: str, given: Mapping[str, Value]) -> Value:
    """
    Return the default of a parameter [SI]; for a gain the values of Table 1 at the given set-points.

    Raises
    ------
    InputError
        If the given set-points are invalid.

    """
    owner, _, gain = name.rpartition('.')
    setpoints = f'{owner}.setpoints'
    if gain not in NAMES or setpoints not in given:
        return DESCRIPTORS[name].default
    try:
        return tuple(getattr(TABLE_1.interpolate(given[setpoints]), gain).tolist())
    except ValueError as error:
        raise InputError(f'{owner}.{error}') from error


def _checked(name: str, value: object) -> Value:
    if name not in DESCRIPTORS:
        raise InputError(f'{name} is not a parameter of a device')
    return DESCRIPTORS[name].checked(value)
