# SPDX-License-Identifier: Apache-2.0
"""`index.html`: a self-contained page of the plant with the drift of each device and links to all reports."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from cfd_pneumatic import __version__
from cfd_pneumatic.charts import SCRIPT_FILE, plot_scripts
from cfd_pneumatic.identification import number, readable_name
from cfd_pneumatic.identification import verdict as verdict_text
from cfd_pneumatic.model import EFFECTS, SPECS
from cfd_pneumatic.plant.drift_chart import Curve, drift_chart
from cfd_pneumatic.plant.history import Change, Device, Part, common_findings, devices, findings_of
from cfd_pneumatic.plant.result_table import CSV_FILE, PARQUET_FILE, Row, column_of
from cfd_pneumatic.plant.trend import trend_of
from cfd_pneumatic.reporting import rendered

TEMPLATES = Path(__file__).parent / 'templates'
TEMPLATE = 'index.html.jinja'

_DAY = 86_400e9  # [ns]
_VERDICTS = ('unexplained', 'shape_found', 'effect_added', 'insufficient_data', 'no_missing_effect', 'fitted', 'failed')


@dataclass(frozen=True)
class Drift:
    """
    A value of a part over all bags.

    Attributes
    ----------
    name, description, unit
        Name, description and unit of the value.
    curves
        Values without and with effects, as far as there are values.

    """

    name: str
    description: str
    unit: str
    curves: tuple[Curve, ...]


def index_page(rows: Sequence[Row]) -> str:
    """Return the HTML page of a plant from the result table: verdicts, changes and drifts of each device."""
    plant = sorted(devices(rows), key=lambda device: _natural_key(device.name))
    entries = [_device_entry(rank, device) for rank, device in enumerate(plant, start=1)]
    return rendered(
        TEMPLATE,
        TEMPLATES,
        scripts=plot_scripts(SCRIPT_FILE),
        version=__version__,
        bags=sum(len(device.bags) for device in plant),
        begin=_date(min((row['time'] for row in rows if row.get('time')), default=None)),
        end=_date(max((row['time'] for row in rows if row.get('time')), default=None)),
        devices=entries,
        changed=sum(bool(device.changes) for device in plant),
        drifting=[(entry, part, trend) for entry in entries for part in entry['parts'] for trend in part['trends']],
        failures=[row for device in plant for row in device.failures],
        verdict_counts=_verdict_counts(plant),
        common=list(_common_descriptions(plant)),
        files=(CSV_FILE, PARQUET_FILE),
    )


def _natural_key(name: str) -> list[tuple[int, str]]:
    """Return a sort key for a name that sorts cell_9 before cell_10."""
    return [(int(digits), '') if digits else (-1, text) for digits, text in re.findall(r'(\d+)|(\D+)', name)]


def _date(time: int | None) -> str:
    if time is None:
        return ''
    return f'{datetime.fromtimestamp(time // 10**9, timezone.utc):%Y-%m-%d %H:%M}'


def _verdict_counts(plant: Sequence[Device]) -> list[dict[str, Any]]:
    """Return the number and share of parts with each latest verdict."""
    verdicts = Counter(part.latest['verdict'] for device in plant for part in device.parts)
    total = sum(verdicts.values())
    return [
        {'verdict': verdict, 'count': verdicts[verdict], 'share': 100.0 * verdicts[verdict] / total}
        for verdict in _VERDICTS
        if verdicts[verdict]
    ]


def _common_descriptions(plant: Sequence[Device]) -> Iterator[str]:
    """Yield a description of each effect or curve that every device has, with the range of its parameters."""
    for name in common_findings(plant):
        sizes = []
        for parameter in EFFECTS[name].parameters if name in EFFECTS else ():
            column = f'{name}.{parameter.name}'
            parameters = [_effect_parameters(part.latest) for device in plant for part in device.parts]
            estimates = [part_parameters.get(column, {}).get('value') for part_parameters in parameters]
            values = [value for value in estimates if value is not None]
            if values and not parameter.choice:
                ends = dict.fromkeys(number(limit) for limit in (min(values), max(values)))
                sizes.append(f'{parameter.name} {" to ".join(ends)} {parameter.unit.strip("-")}'.rstrip())
        yield readable_name(name) + (f' ({", ".join(sizes)})' if sizes else '')


def _effect_parameters(row: Row) -> dict[str, Any]:
    """Return the parameters of the effects in a row."""
    parameters: dict[str, Any] = json.loads(row.get('effect_parameters') or '{}')
    return parameters


def _device_entry(rank: int, device: Device) -> dict[str, Any]:
    """Return the template values of a device."""
    return {
        'id': f'device-{rank}',
        'name': device.name,
        'parts': [_part_entry(part) for part in device.parts],
        'changes': [_change_entry(change) for change in device.changes],
        'failed': len(device.failures),
        'bags': [_bag_entry(rows, device) for rows in reversed(device.bags)],
    }


def _part_entry(part: Part) -> dict[str, Any]:
    changed = [part.rows.index(change.after) for change in part.changes]
    positions = _positions(part.rows)
    drifts = list(_drifts(part.rows))
    return {
        'name': part.name,
        'latest': part.latest,
        'verdict': verdict_description(part.latest),
        'charts': [_chart(drift, part.rows, changed) for drift in drifts],
        'trends': list(_trends(drifts, positions)),
        'span': [_date(part.rows[0].get('time')), _date(part.rows[-1].get('time'))],
    }


def _trends(drifts: Sequence[Drift], positions: Sequence[float]) -> Iterator[dict[str, Any]]:
    """Yield the values that drift, with the begin and the end of the trend; with effects if there are effects."""
    for drift in drifts:
        trend = trend_of(positions, drift.curves[-1].values)
        if trend is not None:
            yield {'name': drift.name, 'description': drift.description, 'unit': drift.unit, **asdict(trend)}


def verdict_description(row: Row) -> str:
    """Return the text of a verdict with its effects, its curve and its warnings."""
    effects = ' and '.join(map(readable_name, findings_of(row)))
    verdict = verdict_text(row['verdict'])
    warnings = f' (check the data: {row["warnings"].replace(";", ", ")})' if row.get('warnings') else ''
    return f'{verdict}: {effects}{warnings}' if effects else f'{verdict}{warnings}'


def _change_entry(change: Change) -> dict[str, Any]:
    return {
        'part': change.after['part'],
        'before': verdict_description(change.before),
        'after': verdict_description(change.after),
        'verdict': change.after['verdict'],
        'report': change.after['report'],
        'when': _date_or_name(change.after),
    }


def _date_or_name(row: Row) -> str:
    """Return the date of a bag, or the name of the bag if there is no date."""
    return _date(row.get('time')) or Path(row['bag']).name


def _bag_entry(rows: Sequence[Row], device: Device) -> dict[str, Any]:
    first = rows[0]
    changed = [change.after for change in device.changes]
    return {
        'when': _date_or_name(first),
        'name': Path(first['bag']).name,
        'report': first.get('report'),
        'parts': [{'row': row, 'verdict': verdict_description(row), 'changed': row in changed} for row in rows],
    }


def _positions(rows: Sequence[Row]) -> list[float]:
    """Return the positions of bags on the time axis, 0 to 1; equally spaced if a time is missing or repeated."""
    times = [row.get('time') for row in rows]
    marks = [time for time in times if time is not None]
    if len(marks) < len(times) or len(set(marks)) < len(marks):
        marks = list(range(len(rows)))
    span = marks[-1] - marks[0]
    return [(mark - marks[0]) / span if span else 0.5 for mark in marks]


def _drifts(rows: Sequence[Row]) -> Iterator[Drift]:
    """Yield the values of a part that have estimates, the error first."""
    for unit in ('Pa', 'N'):
        errors = [_curve(rows, which, column_of('rmse', unit, which)) for which in ('before', 'after')]
        if any(errors):
            yield Drift('error', 'RMS of the residual', unit, tuple(filter(None, errors)))
    for name, unit, description in (*((spec.name, spec.unit, spec.description) for spec in SPECS), _AREA):
        curves = [
            _curve(rows, which or 'before', column_of(name, unit, which), column_of(name, unit, which, 'std'))
            for which in ('', 'after')
        ]
        if any(curves):
            yield Drift(name, description, unit, tuple(filter(None, curves)))
    yield from _effect_drifts(rows)


_AREA = ('area', 'm^2', 'piston area')


def _curve(rows: Sequence[Row], key: str, column: str, std: str = '') -> Curve | None:
    values = [row.get(column) for row in rows]
    if all(value is None for value in values):
        return None
    return Curve(key, values, [row.get(std) for row in rows])


def _effect_drifts(rows: Sequence[Row]) -> Iterator[Drift]:
    """Yield the parameters of all effects in any bag."""
    estimates = [_effect_parameters(row) for row in rows]
    for full_name in dict.fromkeys(name for row_estimates in estimates for name in row_estimates):
        effect, _, name = full_name.partition('.')
        parameter = next(known for known in EFFECTS[effect].parameters if known.name == name)
        values = [row_estimates.get(full_name, {}).get('value') for row_estimates in estimates]
        if any(value is not None for value in values) and not parameter.choice:
            stds = [row_estimates.get(full_name, {}).get('std') for row_estimates in estimates]
            yield Drift(full_name, parameter.description, parameter.unit, (Curve('after', values, stds),))


def _chart(drift: Drift, rows: Sequence[Row], changed: Sequence[int]) -> dict[str, Any]:
    """Return the template values of a chart and its caption."""
    last = drift.curves[-1] if drift.curves[-1].values[-1] is not None else drift.curves[0]
    value, std = last.values[-1], last.stds[-1]
    values = [present for curve in drift.curves for present in curve.present_values]
    value_range = f'{number(min(values))} to {number(max(values))}'
    label = f'{drift.name} over {len(rows)} bags: {value_range} {drift.unit}'
    return {
        'name': drift.name,
        'description': drift.description,
        'unit': drift.unit,
        'value': value,
        'std': std,
        'range': value_range,
        'chart': drift_chart(*_axis(rows), drift.curves, changed, f'{drift.name} [{drift.unit}]', label),
    }


def _axis(rows: Sequence[Row]) -> tuple[list[float], str]:
    """Return the position of each bag and the quantity of the positions: days, or ranks if a time is missing."""
    times = [row['time'] for row in rows if row.get('time') is not None]
    if len(times) < len(rows) or len(set(times)) < len(times):
        return [float(rank) for rank in range(1, len(rows) + 1)], 'bag'
    return [(time - times[0]) / _DAY for time in times], f'time since {_date(times[0])} UTC [days]'
