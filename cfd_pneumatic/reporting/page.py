# SPDX-License-Identifier: Apache-2.0
"""`report.html`: the results of a closed loop on one self-contained page for the operator of the cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from types import MappingProxyType
from typing import Any

from cfd_pneumatic import __version__
from cfd_pneumatic.charts import plot_scripts
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
from cfd_pneumatic.reporting.summary import LABELS, summarise, unfinished
from cfd_pneumatic.reporting.template import rendered

TEMPLATE = 'report.html.jinja'

_EPOCH_OF_TABLES = 1970  # year of recordings without a date: their times begin at zero
_MOST_RECORDINGS = 6  # recordings shown in full length
_FORCE_PARAMETERS = {
    'area': 'piston area',
    'geometric_factor': 'contact force / piston force, from the linkage; as given',
}
_FIRST_TRIALS = 6  # candidates of a round that are shown without unfolding


@dataclass(frozen=True)
class Row:
    """A row of the parameter table: the estimates without and with effects."""

    name: str
    description: str
    unit: str
    before: Estimate | None
    after: Estimate | None
    choice: bool = False
    paper_unit: str = ''
    paper_factor: float = 1.0


def report_page(
    identification: Identification,
    live_errors: Mapping[str, PartError] = MappingProxyType({}),
    run: str = '',
    scripts: str | None = '',
) -> str:
    """
    Return the report page of a closed loop.

    Parameters
    ----------
    identification, live_errors
        Results; errors of `sim_node`, which computes sample by sample, by channel.
    run
        Name of the run.
    scripts
        Relative address of scripts that several pages share; empty to put the scripts into the page; None for a page
        with static pictures only.

    """
    sections = [
        _section(result, live_errors.get(result.name)) | {'summary': summarise(result, identification)}
        for result in identification.closed
    ]
    return rendered(
        TEMPLATE,
        version=__version__,
        run=run,
        scripts='' if scripts is None else plot_scripts(scripts),
        recordings=identification.recordings,
        dates=[_date(recording) for recording in identification.recordings],
        warnings=[notice for notice in identification.notices if notice.level == WARNING],
        notes=[notice for notice in identification.notices if notice.level == NOTE],
        changes=identification.changes,
        splits=identification.splits,
        no_test=identification.no_test,
        sections=sections,
        labels=LABELS,
        parts=PARTS,
        effects=EFFECTS,
        next_plan=next_plan(identification),
        scheduled=[  # the reported models of these cylinders have gains of each set-point, not of the joint fit
            name
            for name, result in identification.cylinders.items()
            if not result.added and any(point.fit is not result.fit for point in result.schedule)
        ],
    )


def _date(recording: Recording) -> str:
    """Return when a recording began; empty if the recording has no date."""
    began = datetime.fromtimestamp(recording.epoch / 1e9, tz=timezone.utc)
    return f'{began:%Y-%m-%d %H:%M} UTC' if began.year > _EPOCH_OF_TABLES else ''


def _section(result: ChannelResult, live: PartError | None) -> dict[str, Any]:
    """Return the template values of a channel's section."""
    findings = result.findings
    shown = result.comparisons[:_MOST_RECORDINGS]
    return {
        'id': result.name,
        'title': title(result.name),
        'result': result,
        'findings': findings,
        'bars': list(_bars(result)),
        'charts': figures.charts_by_section(result, shown),
        'not_shown': [comparison.name for comparison in result.comparisons[_MOST_RECORDINGS:]],
        'errors': list(_errors(result)),
        'live': live,
        'remaining_error': describe_remaining_error(result),
        'unfinished': unfinished(findings) if findings.not_tried else '',
        'rounds': [_round(trials) for trials in findings.rounds],
        'tests': _test_pairs(findings.tests_before, findings.tests_after),
        'parameters': list(_gain_rows(result)),
        'effect_parameters': {effect: list(_effect_rows(result, effect)) for effect in result.added},
        'rivals': {effect: rivals for effect, rivals in findings.alternatives.items() if rivals},
    }


def _bars(result: ChannelResult) -> Iterator[dict[str, Any]]:
    """Yield the bars of the errors before and after and of the noise; lengths in percent of the longest bar."""
    values = {'before': result.rmse(0)}
    if result.added:
        values['after'] = result.rmse(1)
    values['noise'] = result.noise.std
    names = {
        'before': 'model without effects',
        'after': f'model with {" and ".join(readable_name(effect) for effect in result.added)}',
        'noise': 'sensor noise alone',
    }
    longest = max(values.values()) or 1.0
    for key, value in values.items():
        yield {'key': key, 'name': names[key], 'value': value, 'length': max(100.0 * value / longest, 0.5)}


def _errors(result: ChannelResult) -> Iterator[tuple[str, PartError, PartError | None]]:
    """Yield each part with its error before and, if effects were added, after."""
    for part in PARTS:
        if part in result.before:
            yield part, result.before[part], result.after.get(part) if result.added else None


def _round(trials: Sequence[Trial]) -> dict[str, Any]:
    """Return a round of the search, its first candidates separate from the folded candidates."""
    first = [trial for rank, trial in enumerate(trials) if rank < _FIRST_TRIALS or trial.accepted]
    folded = [trial for trial in trials if trial not in first]
    return {'added_before': trials[0].present_effects, 'first': first, 'folded': folded}


def _test_pairs(before: Sequence[Test], after: Sequence[Test]) -> list[tuple[Test, Test | None]]:
    """Return pairs of the same test on the residual before and after."""
    tests_after = {test.name: test for test in after}
    return [(test, tests_after.get(test.name)) for test in before]


def _gain_rows(result: ChannelResult) -> Iterator[Row]:
    """Yield the rows of the parameters that do not belong to an effect."""
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
            paper = (spec.paper_unit, spec.paper_factor) if spec.paper_unit != spec.unit else ('', 1.0)
            yield Row(name, description, unit, before.get(name), with_effects, False, *paper)


def _effect_rows(result: ChannelResult, effect: str) -> Iterator[Row]:
    """Yield the rows of an effect's parameters."""
    parameters = {parameter.name: parameter for parameter in result.channel.effects[effect].parameters}
    for name, estimate in result.parameters(effect).items():
        yield Row(name, parameters[name].description, estimate.unit, None, estimate, parameters[name].choice)
