"""What an identification says: strict JSON, a parameter file for `sim_node`, and tables for people."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from cfd_pneumatic.convention import SUPPLY_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification.fit import Estimate, Fit
from cfd_pneumatic.identification.identify import CylinderResult, Identification
from cfd_pneumatic.identification.split import PARTS
from cfd_pneumatic.model import NAMES, SPECS
from cfd_pneumatic.units import PSI

SCHEMA = 1
REPORT_FILE = 'report.json'
PARAMETER_FILE = 'parameters.yaml'


def report_data(identification: Identification) -> dict[str, Any]:
    """Return the report as JSON types; numbers in SI units, null where there is none."""
    return {
        'schema': SCHEMA,
        'recordings': [
            {
                'name': recording.name,
                'displacement_samples': recording.displacement.times.size,
                'duration_s': float(recording.displacement.times[-1] - recording.displacement.times[0]),
                'notes': list(recording.health),
            }
            for recording in identification.recordings
        ],
        'split': {
            'no_test_part': identification.no_test,
            'recordings': [
                {
                    'part': split.whole,
                    'validation_from_s': _finite(split.bounds[0]),
                    'test_from_s': _finite(split.bounds[1]),
                    'strokes': dict(zip(PARTS, split.strokes)),
                }
                for split in identification.splits
            ],
        },
        'ambient_pressure_pa': identification.ambient_pressure,
        'cylinders': {name: _cylinder_data(result) for name, result in identification.cylinders.items()},
    }


def _finite(value: float) -> float | None:
    return value if abs(value) != float('inf') else None


def _cylinder_data(result: CylinderResult) -> dict[str, Any]:
    return {
        'parameters': _parameter_data(result.fit),
        'schedule': [
            {'setpoint_pa': point.setpoint, 'parameters': _parameter_data(point.fit)} for point in result.schedule
        ],
        'setpoints': [
            {
                'recording': experiment.recording,
                'recorded': experiment.setpoint_recorded,
                ('offset_pa' if experiment.setpoint_recorded else 'estimated_pa'): (
                    offset if experiment.setpoint_recorded else float(experiment.setpoint[0]) + offset
                ),
                'std_pa': std,
                'displacement_noise_m': experiment.motion.noise,
            }
            for experiment, offset, std in zip(result.experiments, result.fit.offsets, result.fit.offset_stds)
        ],
        'span_pa': result.span,
        'noise_floor_pa': result.noise_floor,
        'before': {
            part: {'rmse_pa': error.rmse, 'nrmse_percent': error.nrmse_percent} for part, error in result.before.items()
        },
        'notes': list(result.notes),
    }


def _parameter_data(fit: Fit) -> dict[str, Any]:
    return {
        estimate.name: {
            'value': estimate.value,
            'std': estimate.std,
            'ci95': None if estimate.interval is None else list(estimate.interval),
            'unit': estimate.unit,
            'identifiable': estimate.identifiable,
            'reason': estimate.reason,
        }
        for estimate in fit.estimates
    }


def parameter_file(identification: Identification) -> str:
    """
    Return a ROS parameter file that `sim_node` runs with as it is.

    A parameter that is identifiable at no set-point is left out with a comment; `sim_node` then takes Table 1's. One
    identifiable at some set-points only is held from the nearest of those.
    """
    lines = ['/**:', '  ros__parameters:', f'    ambient_pressure: {_float(identification.ambient_pressure)}  # Pa']
    highest = max(point.setpoint for result in identification.cylinders.values() for point in result.schedule)
    if highest > SUPPLY_PRESSURE:
        lines.append(
            f'    supply_pressure: {_float(1.2 * highest)}  # Pa, gauge; not measured, leaves room for set-points'
        )
    for cylinder, result in identification.cylinders.items():
        lines += [
            f'    {cylinder}:',
            f'      initial_setpoint: {_float(result.schedule[0].setpoint)}  # Pa, gauge',
            f'      setpoints: {_floats([point.setpoint for point in result.schedule])}  # Pa, gauge',
        ]
        for rank, spec in enumerate(SPECS):
            values = _held([point.fit.estimates[rank] for point in result.schedule])
            if values is None:
                reason = result.schedule[0].fit.estimates[rank].reason
                lines.append(f'      # {spec.name} is not identifiable and left out: {reason}')
            else:
                lines.append(f'      {spec.name}: {_floats(values)}  # {spec.unit}')
    text = '\n'.join(lines) + '\n'
    yaml.safe_load(text)
    return text


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


def write_report(identification: Identification, folder: Path) -> None:
    """
    Write `report.json` and `parameters.yaml` into a folder, made if need be; earlier ones stay until the new are whole.

    Raises
    ------
    InputError
        If the folder can't be written.

    """
    make_folder(folder)
    write_text(folder / REPORT_FILE, json.dumps(report_data(identification), indent=2, allow_nan=False) + '\n')
    write_text(folder / PARAMETER_FILE, parameter_file(identification))


def make_folder(folder: Path) -> None:
    """
    Make an output folder, so that a bad one is found before the work is done.

    Raises
    ------
    InputError
        If it can't be made or written.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / '.writable', '')
        (folder / '.writable').unlink()
    except OSError as error:
        raise InputError(
            f'cannot write to {folder}: {error.strerror}; choose a folder that you may write to'
        ) from error


def print_report(identification: Identification, console: Console) -> None:
    """Print tables of parameters and errors, the paper's units beside SI."""
    for recording in identification.recordings:
        for note in _merged(recording.health):
            console.print(f'{recording.name}: {note}', style='yellow', highlight=False)
    for cylinder, result in identification.cylinders.items():
        for point in result.schedule:
            console.print(_parameter_table(cylinder, point.setpoint, point.fit))
        for note in result.notes:
            console.print(note, style='yellow', highlight=False)
        console.print(_error_table(cylinder, result))
    if identification.no_test is not None:
        console.print(f'No test part: {identification.no_test}.', highlight=False)


def _merged(notes: Sequence[str]) -> list[str]:
    """Return notes of the form 'signal: what' with the signals that share one gathered in front of it."""
    signals: dict[str, list[str]] = {}
    for note in notes:
        signal, _, what = note.rpartition(': ')
        signals.setdefault(what, []).append(signal)
    return [f'{", ".join(names)}: {what}' if any(names) else what for what, names in signals.items()]


def _parameter_table(cylinder: str, setpoint: float, fit: Fit) -> Table:
    title = f'{cylinder} at {setpoint / 1e3:.1f} kPa ({setpoint / PSI:.2f} psi) gauge'
    table = Table(title=title, title_justify='left')
    for heading in ('parameter', 'value', 'standard error', '95 % interval', 'unit', "in the paper's unit"):
        table.add_column(heading, justify='left' if heading in ('parameter', 'unit') else 'right')
    for spec, estimate in zip(SPECS, fit.estimates):
        if estimate.value is None or estimate.std is None or estimate.interval is None:
            table.add_row(spec.name, 'not identifiable', '', '', '', '')
            continue
        low, high = estimate.interval
        table.add_row(
            spec.name,
            f'{estimate.value:.4g}',
            f'{estimate.std:.2g}',
            f'{low:.4g} to {high:.4g}',
            spec.unit,
            f'{estimate.value / spec.paper_factor:.4g} {spec.paper_unit}',
        )
    reasons = [f'{name}: {estimate.reason}' for name, estimate in zip(NAMES, fit.estimates) if estimate.reason]
    if reasons:
        table.caption = '\n'.join(reasons)
        table.caption_justify = 'left'
    return table


def _error_table(cylinder: str, result: CylinderResult) -> Table:
    table = Table(title=f'{cylinder}: simulated against measured pressure', title_justify='left')
    for heading in ('part', 'samples', 'RMSE, Pa', 'RMSE, mpsi', 'NRMSE, % of span'):
        table.add_column(heading, justify='left' if heading == 'part' else 'right')
    for index, part in enumerate(PARTS):
        error = result.before.get(part)
        if error is not None:
            count = sum(int((experiment.part == index).sum()) for experiment in result.experiments)
            table.add_row(
                part, str(count), f'{error.rmse:.1f}', f'{1e3 * error.rmse / PSI:.1f}', f'{error.nrmse_percent:.2f}'
            )
    table.caption = (
        f'span p99 - p1: {result.span:.0f} Pa ({result.span / PSI:.3f} psi); noise floor {result.noise_floor:.1f} Pa'
    )
    table.caption_justify = 'left'
    return table
