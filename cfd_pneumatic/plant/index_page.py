# SPDX-License-Identifier: Apache-2.0
"""`index.html`: the whole plant on one page that stands alone, each device with its drift, linked to all reports."""

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
from cfd_pneumatic.identification import number, readable_name
from cfd_pneumatic.identification import verdict as verdict_text
from cfd_pneumatic.model import EFFECTS, SPECS
from cfd_pneumatic.plant.drift_chart import Curve, drift_chart
from cfd_pneumatic.plant.history import Change, Device, Part, devices, named_by, named_on_all
from cfd_pneumatic.plant.result_table import CSV_FILE, PARQUET_FILE, Row, column_of
from cfd_pneumatic.plant.trend import trend_of
from cfd_pneumatic.reporting import rendered

TEMPLATES = Path(__file__).parent / 'templates'
TEMPLATE = 'index.html.jinja'

_VERDICTS = ('unexplained', 'shape_found', 'effect_added', 'insufficient_data', 'no_missing_effect', 'fitted', 'failed')


@dataclass(frozen=True)
class Drift:
    """
    One value of a part over all bags.

    Attributes
    ----------
    name, description, unit
        Of the value.
    tracks
        Without and with the effects, so far as there are any.

    """

    name: str
    description: str
    unit: str
    tracks: tuple[Curve, ...]


def index_page(rows: Sequence[Row]) -> str:
    """Return the page on all rows, which are in the order of the table."""
    plant = sorted(devices(rows), key=lambda device: _natural(device.name))
    told = [_device(rank, device) for rank, device in enumerate(plant, start=1)]
    return rendered(
        TEMPLATE,
        TEMPLATES,
        version=__version__,
        bags=sum(len(device.bags) for device in plant),
        begin=_date(min((row['time'] for row in rows if row.get('time')), default=None)),
        end=_date(max((row['time'] for row in rows if row.get('time')), default=None)),
        devices=told,
        changed=sum(bool(device.changes) for device in plant),
        drifting=[(one, part, trend) for one in told for part in one['parts'] for trend in part['trends']],
        failures=[row for device in plant for row in device.failures],
        tally=_tally(plant),
        common=list(_common(plant)),
        files=(CSV_FILE, PARQUET_FILE),
    )


def _natural(name: str) -> list[tuple[int, str]]:
    """Return what sorts cell_9 before cell_10."""
    return [(int(digits), '') if digits else (-1, text) for digits, text in re.findall(r'(\d+)|(\D+)', name)]


def _date(time: int | None) -> str:
    if time is None:
        return ''
    return f'{datetime.fromtimestamp(time // 10**9, timezone.utc):%Y-%m-%d %H:%M}'


def _tally(plant: Sequence[Device]) -> list[dict[str, Any]]:
    """Return how often each verdict is the last one, part by part."""
    verdicts = Counter(part.now['verdict'] for device in plant for part in device.parts)
    total = sum(verdicts.values())
    return [
        {'verdict': verdict, 'count': verdicts[verdict], 'share': 100.0 * verdicts[verdict] / total}
        for verdict in _VERDICTS
        if verdicts[verdict]
    ]


def _common(plant: Sequence[Device]) -> Iterator[str]:
    """Yield what every device shows, in words, and how large it is: what is the same everywhere is the set-up's."""
    for name in named_on_all(plant):
        sizes = []
        for parameter in EFFECTS[name].parameters if name in EFFECTS else ():
            column = f'{name}.{parameter.name}'
            told = [_sizes(part.now).get(column, {}).get('value') for device in plant for part in device.parts]
            values = [one for one in told if one is not None]
            if values and not parameter.choice:
                ends = dict.fromkeys(number(one, 3) for one in (min(values), max(values)))
                sizes.append(f'{parameter.name} {" to ".join(ends)} {parameter.unit.strip("-")}'.rstrip())
        yield readable_name(name) + (f' ({", ".join(sizes)})' if sizes else '')


def _sizes(row: Row) -> dict[str, Any]:
    """Return the parameters of the effects that a row names."""
    found: dict[str, Any] = json.loads(row.get('effect_parameters') or '{}')
    return found


def _device(rank: int, device: Device) -> dict[str, Any]:
    """Return what the page says about a device."""
    return {
        'id': f'device-{rank}',
        'name': device.name,
        'parts': [_part(part) for part in device.parts],
        'changes': [_change(change) for change in device.changes],
        'failed': len(device.failures),
        'bags': [_bag(rows, device) for rows in reversed(device.bags)],
    }


def _part(part: Part) -> dict[str, Any]:
    changed = [part.rows.index(change.after) for change in part.changes]
    places = _places(part.rows)
    drifts = list(_drifts(part.rows))
    return {
        'name': part.name,
        'now': part.now,
        'what': said(part.now),
        'charts': [_chart(drift, places, changed) for drift in drifts],
        'trends': list(_trends(drifts, places)),
        'span': [_date(part.rows[0].get('time')), _date(part.rows[-1].get('time'))],
    }


def _trends(drifts: Sequence[Drift], places: Sequence[float]) -> Iterator[dict[str, Any]]:
    """Yield what drifts, beside the effects where there are any, with where it began and where it is."""
    for drift in drifts:
        found = trend_of(places, drift.tracks[-1].values)
        if found is not None:
            yield {'name': drift.name, 'description': drift.description, 'unit': drift.unit, **asdict(found)}


def said(row: Row) -> str:
    """Return a verdict in words, with the effects and the law that it names."""
    effects = ' and '.join(map(readable_name, named_by(row)))
    verdict = verdict_text(row['verdict'])
    doubt = f' (in doubt: {row["warnings"].replace(";", ", ")})' if row.get('warnings') else ''
    return f'{verdict}: {effects}{doubt}' if effects else f'{verdict}{doubt}'


def _change(change: Change) -> dict[str, Any]:
    return {
        'part': change.after['part'],
        'before': said(change.before),
        'after': said(change.after),
        'verdict': change.after['verdict'],
        'report': change.after['report'],
        'when': _when(change.after),
    }


def _when(row: Row) -> str:
    """Return when a bag was recorded, or else its name."""
    return _date(row.get('time')) or Path(row['bag']).name


def _bag(rows: Sequence[Row], device: Device) -> dict[str, Any]:
    first = rows[0]
    changed = [change.after for change in device.changes]
    return {
        'when': _when(first),
        'name': Path(first['bag']).name,
        'report': first.get('report'),
        'parts': [{'row': row, 'what': said(row), 'changed': row in changed} for row in rows],
    }


def _places(rows: Sequence[Row]) -> list[float]:
    """Return where bags stand from left to right, 0 to 1: by time, or one after the other where not all have one."""
    times = [row.get('time') for row in rows]
    marks = [time for time in times if time is not None]
    if len(marks) < len(times) or len(set(marks)) < len(marks):
        marks = list(range(len(rows)))
    span = marks[-1] - marks[0]
    return [(mark - marks[0]) / span if span else 0.5 for mark in marks]


def _drifts(rows: Sequence[Row]) -> Iterator[Drift]:
    """Yield the values of a part that are there, the error first."""
    for unit in ('Pa', 'N'):
        errors = [_track(rows, which, column_of('rmse', unit, which)) for which in ('before', 'after')]
        if any(errors):
            yield Drift('error', 'RMS of what the model leaves', unit, tuple(filter(None, errors)))
    for name, unit, description in (*((spec.name, spec.unit, spec.description) for spec in SPECS), _AREA):
        tracks = [
            _track(rows, which or 'before', column_of(name, unit, which), column_of(name, unit, which, 'std'))
            for which in ('', 'after')
        ]
        if any(tracks):
            yield Drift(name, description, unit, tuple(filter(None, tracks)))
    yield from _effect_drifts(rows)


_AREA = ('area', 'm^2', 'piston area')


def _track(rows: Sequence[Row], key: str, column: str, std: str = '') -> Curve | None:
    values = [row.get(column) for row in rows]
    if all(value is None for value in values):
        return None
    return Curve(key, values, [row.get(std) for row in rows])


def _effect_drifts(rows: Sequence[Row]) -> Iterator[Drift]:
    """Yield the parameters of the effects that were found in any bag."""
    found = [_sizes(row) for row in rows]
    for full in dict.fromkeys(name for one in found for name in one):
        effect, _, name = full.partition('.')
        parameter = next(one for one in EFFECTS[effect].parameters if one.name == name)
        values = [one.get(full, {}).get('value') for one in found]
        if any(value is not None for value in values) and not parameter.choice:
            stds = [one.get(full, {}).get('std') for one in found]
            yield Drift(full, parameter.description, parameter.unit, (Curve('after', values, stds),))


def _chart(drift: Drift, places: Sequence[float], changed: Sequence[int]) -> dict[str, Any]:
    """Return a chart with the words above it."""
    last = drift.tracks[-1] if drift.tracks[-1].values[-1] is not None else drift.tracks[0]
    value, std = last.values[-1], last.stds[-1]
    values = [one for track in drift.tracks for one in track.told]
    told = f'{number(min(values), 3)} to {number(max(values), 3)}'
    label = f'{drift.name} over {len(places)} bags: {told} {drift.unit}'
    return {
        'name': drift.name,
        'description': drift.description,
        'unit': drift.unit,
        'value': value,
        'doubt': abs(std / value) if std and value else None,
        'range': told,
        'svg': drift_chart(places, drift.tracks, changed, label),
    }
