# SPDX-License-Identifier: Apache-2.0
"""`report.html`: one page that stands alone, for whoever runs the cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from types import MappingProxyType
from typing import Any

from cfd_pneumatic import __version__
from cfd_pneumatic.identification import (
    PARTS,
    ChannelResult,
    Estimate,
    Identification,
    PartError,
    Test,
    Trial,
    describe_remaining_error,
    readable_name,
    title,
)
from cfd_pneumatic.model import EFFECTS, SPECS
from cfd_pneumatic.notices import NOTE, WARNING
from cfd_pneumatic.recording import Recording
from cfd_pneumatic.reporting import figures
from cfd_pneumatic.reporting.advice import next_plan
from cfd_pneumatic.reporting.template import rendered

TEMPLATE = 'report.html.jinja'

_EPOCH_OF_TABLES = 1970  # in which times begin that are no dates
_MOST_RECORDINGS = 6  # that are drawn whole
_FORCE_PARAMETERS = {
    'area': 'piston area',
    'geometric_factor': 'contact force over piston force, from the linkage; as given',
}
_FIRST_TRIALS = 6  # of a round that are shown at once


@dataclass(frozen=True)
class Row:
    """A parameter: without and with the effects."""

    name: str
    description: str
    unit: str
    before: Estimate | None
    after: Estimate | None
    choice: bool = False
    paper_unit: str = ''
    paper_factor: float = 1.0


def report_page(
    identification: Identification, live: Mapping[str, PartError] = MappingProxyType({}), run: str = ''
) -> str:
    """Return the page on what closing the loop brought, with the errors of a live simulation and the run's name."""
    sections = [_section(result, live.get(result.name)) for result in identification.closed]
    return rendered(
        TEMPLATE,
        version=__version__,
        run=run,
        recordings=identification.recordings,
        dates=[_date(recording) for recording in identification.recordings],
        warnings=[one for one in identification.notices if one.level == WARNING],
        notes=[one for one in identification.notices if one.level == NOTE],
        splits=identification.splits,
        no_test=identification.no_test,
        sections=sections,
        parts=PARTS,
        effects=EFFECTS,
        next_plan=next_plan(identification),
        scheduled=[  # whose model that is reported has other gains than the one fit to all set-points
            name
            for name, one in identification.cylinders.items()
            if not one.added and any(point.fit is not one.fit for point in one.schedule)
        ],
    )


def _date(recording: Recording) -> str:
    """Return when a recording began, nothing where its times have a zero of their own."""
    began = datetime.fromtimestamp(recording.epoch / 1e9, tz=timezone.utc)
    return f'{began:%Y-%m-%d %H:%M} UTC' if began.year > _EPOCH_OF_TABLES else ''


def _section(result: ChannelResult, live: PartError | None) -> dict[str, Any]:
    """Return what the page says about one cylinder, or about the force."""
    findings = result.findings
    drawn = result.comparisons[:_MOST_RECORDINGS]
    return {
        'id': result.name,
        'title': title(result.name),
        'result': result,
        'findings': findings,
        'bars': list(_bars(result)),
        'pictures': figures.pictures(result, drawn),
        'not_drawn': [comparison.name for comparison in result.comparisons[_MOST_RECORDINGS:]],
        'errors': list(_errors(result)),
        'live': live,
        'remainder': describe_remaining_error(result),
        'rounds': [_round(trials) for trials in findings.rounds],
        'tests': _tests(findings.tests_before, findings.tests_after),
        'parameters': list(_gain_rows(result)),
        'effect_parameters': {effect: list(_effect_rows(result, effect)) for effect in result.added},
        'rivals': {effect: rivals for effect, rivals in findings.alternatives.items() if rivals},
    }


def _bars(result: ChannelResult) -> Iterator[dict[str, Any]]:
    """Yield the error before and after and the noise, as lengths in percent of the longest."""
    values = {'before': result.rmse(0)}
    if result.added:
        values['after'] = result.rmse(1)
    values['noise'] = result.noise.std
    names = {
        'before': result.quantity.model,
        'after': f'with {" and ".join(readable_name(effect) for effect in result.added)}',
        'noise': 'sensor noise alone',
    }
    longest = max(values.values()) or 1.0
    for key, value in values.items():
        yield {'key': key, 'name': names[key], 'value': value, 'length': max(100.0 * value / longest, 0.5)}


def _errors(result: ChannelResult) -> Iterator[tuple[str, PartError, PartError | None]]:
    """Yield each part with its errors before and, where there are effects, after."""
    for part in PARTS:
        if part in result.before:
            yield part, result.before[part], result.after.get(part) if result.added else None


def _round(trials: Sequence[Trial]) -> dict[str, Any]:
    """Return a round of the search with the trials that are shown at once apart from the others."""
    first = [trial for rank, trial in enumerate(trials) if rank < _FIRST_TRIALS or trial.accepted]
    return {
        'beside': trials[0].present_effects,
        'first': first,
        'rest': [trial for trial in trials if trial not in first],
    }


def _tests(before: Sequence[Test], after: Sequence[Test]) -> list[tuple[Test, Test | None]]:
    """Return each test of the residual before with that after."""
    later = {test.name: test for test in after}
    return [(test, later.get(test.name)) for test in before]


def _gain_rows(result: ChannelResult) -> Iterator[Row]:
    """Yield the model's own parameters."""
    specs = {spec.name: spec for spec in SPECS}
    after = {estimate.name: estimate for estimate in result.gains}
    before = {estimate.name: estimate for estimate in result.fit.estimates}
    for name in dict.fromkeys([*before, *after]):
        unit = (before.get(name) or after[name]).unit
        spec = specs.get(name)
        with_effects = after.get(name) if result.added else None
        if spec is None:
            yield Row(name, _FORCE_PARAMETERS.get(name, ''), unit, before.get(name), after.get(name))
        else:
            description = spec.description.partition(',')[0]
            own = (spec.paper_unit, spec.paper_factor) if spec.paper_unit != spec.unit else ('', 1.0)
            yield Row(name, description, unit, before.get(name), with_effects, False, *own)


def _effect_rows(result: ChannelResult, effect: str) -> Iterator[Row]:
    """Yield an effect's parameters."""
    known = {parameter.name: parameter for parameter in result.channel.effects[effect].parameters}
    for name, estimate in result.parameters(effect).items():
        yield Row(name, known[name].description, estimate.unit, None, estimate, known[name].choice)
