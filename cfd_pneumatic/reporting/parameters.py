"""`parameters.yaml`: a ROS parameter file that `sim_node` runs with as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import yaml

from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS, SUPPLY_PRESSURE
from cfd_pneumatic.identification import ChannelResult, Estimate, Geometry, Identification
from cfd_pneumatic.model import SPECS
from cfd_pneumatic.model.effects import FORCE_EFFECTS, PRESSURE_EFFECTS, Effect

_SEAL_PLAY = 3.0  # standard deviations of the displacement's noise, as `sim_node` describes it
_LARGEST_SEAL_PLAY = 1e-3  # that `sim_node` takes [m]


def parameter_file(identification: Identification) -> str:
    """
    Return the file's text.

    A parameter that is identifiable at no set-point is left out, with the value that the fit used in a comment:
    `sim_node` takes Table 1's, since the recordings hardly depend on it and what a fit made of that may be anything, a
    bound too. One identifiable at some set-points only is held from the nearest of those. Where closing the loop found
    effects, they are on, and the gains are those fitted beside them, at every set-point and whether identifiable or
    not: only together do they simulate what was reported. A cylinder that was not recorded is switched off: the force
    was made without it. The area is there whenever it was identified, held or given.
    """
    lines = ['/**:', '  ros__parameters:', f'    ambient_pressure: {_float(identification.ambient_pressure)}  # Pa']
    highest = max(point.setpoint for result in identification.cylinders.values() for point in result.schedule)
    if highest > SUPPLY_PRESSURE:
        lines.append(
            f'    supply_pressure: {_float(1.2 * highest)}  # Pa, gauge; not measured, leaves room for set-points'
        )
    lines += _geometry_lines(identification.geometry)
    for cylinder in CYLINDERS:
        lines.append(f'    {cylinder}:')
        if cylinder in identification.cylinders:
            lines += _cylinder_lines(identification.cylinders[cylinder])
        else:
            lines.append('      enabled: false  # its pressure was not recorded: ambient pressure takes its place')
    force = identification.channels.get('force')
    if force is not None and force.found.model.effects:
        lines += _force_lines(force)
    text = '\n'.join(lines) + '\n'
    yaml.safe_load(text)
    return text


def _cylinder_lines(result: ChannelResult) -> list[str]:
    return _extended_lines(result) if result.found.model.effects else _schedule_lines(result)


def _schedule_lines(result: ChannelResult) -> list[str]:
    """Return the gains at each set-point."""
    lines = _setpoint_lines([point.setpoint for point in result.schedule])
    for rank, spec in enumerate(SPECS):
        estimates = [point.fit.estimates[rank] for point in result.schedule]
        values = _held(estimates)
        if values is None:
            used = _floats([point.fit.model.parameters[rank] for point in result.schedule])
            lines.append(
                f"      # {spec.name} is not identifiable and left out, sim_node takes Table 1's; the fit used {used} "
                f'{spec.unit}: {estimates[0].reason}'
            )
        else:
            held = [point.setpoint for point, one in zip(result.schedule, estimates) if not one.identifiable]
            doubt = f'; not identifiable and held from the nearest at {_floats(held)} Pa' if held else ''
            lines.append(f'      {spec.name}: {_floats(values)}  # {spec.unit}{doubt}')
    return lines


def _extended_lines(result: ChannelResult) -> list[str]:
    """Return the gains, the same at every set-point, and the effects beside which they were fitted."""
    found = result.found
    levels = result.channel.levels(result.experiments, found.model)
    lines = _setpoint_lines([float(np.mean(np.concatenate(levels)))])
    for spec, value, estimate in zip(SPECS, found.model.parameters.tolist(), found.estimates):
        doubt = '' if estimate.reason is None else f'; not identifiable, as the fit used it: {estimate.reason}'
        lines.append(f'      {spec.name}: {_floats([_within(value, spec.lower, spec.upper)])}  # {spec.unit}{doubt}')
    return lines + _effect_lines(found.model.effects, PRESSURE_EFFECTS)


def _setpoint_lines(setpoints: Sequence[float]) -> list[str]:
    """Return the gauge set-points at which gains are given; the device starts at the first [Pa]."""
    return [
        f'      initial_setpoint: {_float(setpoints[0])}  # Pa, gauge',
        f'      setpoints: {_floats(setpoints)}  # Pa, gauge',
    ]


def _effect_lines(effects: Mapping[str, Sequence[float]], library: Mapping[str, Effect]) -> list[str]:
    """Return what switches effects on, below a cylinder or the contact force."""
    lines = []
    for name, own in effects.items():
        lines += [f'      {name}:', '        enabled: true']
        for parameter, value in zip(library[name].parameters, own):
            number = _float(_within(value, parameter.lower, parameter.upper))
            lines.append(f'        {parameter.name}: {number}  # {parameter.unit}')
    return lines


def _geometry_lines(geometry: Geometry) -> list[str]:
    """Return area and geometric factor, as far as they are known: the force is their product times the pressure."""
    lines = []
    if geometry.area is not None:
        note = '' if geometry.note is None else f'; {geometry.note}'
        lines.append(f'    area: {_float(geometry.area)}  # m^2{note}')
    elif geometry.note is not None:
        lines.append(f'    # area is left out: {geometry.note}')
    if geometry.factor is not None:
        lines.append(f'    geometric_factor: {_float(geometry.factor)}  # -; only its product with the area shows')
    return lines


def _force_lines(result: ChannelResult) -> list[str]:
    """Return the effects on the force."""
    effects = result.found.model.effects
    lines = [f'    {CONTACT_FORCE}:']
    if any(FORCE_EFFECTS[name].states for name in effects):
        play = min(_SEAL_PLAY * max(one.motion.noise for one in result.experiments), _LARGEST_SEAL_PLAY)
        lines.append(f"      seal_play: {_float(play)}  # m, three standard deviations of the displacement's noise")
    return lines + _effect_lines(effects, FORCE_EFFECTS)


def _within(value: float, lower: float, upper: float) -> float:
    """Return a value within bounds: a search in logarithms may end a rounding error beyond them."""
    return min(max(float(value), lower), upper)


def _floats(values: Sequence[float]) -> str:
    """Return a YAML list that every reader takes for floats; an integer among them would stop rclpy."""
    return '[' + ', '.join(_float(value) for value in values) + ']'


def _float(value: float) -> str:
    """Return a number with a decimal point, without which YAML 1.1 reads 5e-05 as text."""
    digits, exponent, power = repr(float(value)).partition('e')
    return (digits if '.' in digits else f'{digits}.0') + exponent + power


def _held(estimates: list[Estimate]) -> list[float] | None:
    """Return values with gaps filled from the nearest identifiable neighbour, or None where there is none."""
    known = np.array([index for index, estimate in enumerate(estimates) if estimate.value is not None], dtype=np.intp)
    if known.size == 0:
        return None
    nearest = (int(known[np.argmin(np.abs(known - index))]) for index in range(len(estimates)))
    return [float(estimates[index].value or 0.0) for index in nearest]
