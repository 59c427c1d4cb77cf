# SPDX-License-Identifier: Apache-2.0
"""Tables and verdicts for the terminal, in SI units and in the units of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from cfd_pneumatic.identification import (
    PARTS,
    ChannelResult,
    Estimate,
    Identification,
    PartError,
    describe_remaining_error,
    percent,
    reservation,
    sentence,
    title,
    verdict,
)
from cfd_pneumatic.model import NAMES, SPECS
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.reporting.summary import LABELS, summarise, unfinished
from cfd_pneumatic.terminal import table
from cfd_pneumatic.units import PSI

_STYLES = {
    'shape_found': 'bold cyan',
    'effect_added': 'bold cyan',
    'no_missing_effect': 'bold green',
    'unexplained': 'bold yellow',
}
_LEAST_BIC = 0.0  # effects that do not lower the criterion are listed in the report only


def print_summary(identification: Identification, console: Console) -> None:
    """Print data checks, and the summary of each channel; parameters and errors if the loop was not closed."""
    if not identification.closed:
        print_report(identification, console)
        return
    _print_data_checks(identification, console)
    for result in identification.closed:
        summary = summarise(result, identification)
        console.print()
        heading = f'{title(result.name)}: {verdict(result.findings.verdict)}{reservation(result.findings)}.'
        console.print(Text(heading, _STYLES.get(result.findings.verdict, 'bold')))
        for name, text in zip(LABELS, summary):
            console.print(Padding(_labelled(name, text), (0, 0, 0, 2)))


def _labelled(name: str, text: str) -> Table:
    """Return a label and a text that wraps next to the label."""
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(width=11)
    grid.add_column()
    grid.add_row(name, Text(text))
    return grid


def _print_data_checks(identification: Identification, console: Console) -> None:
    for recording in identification.recordings:
        for note in _merge_notes(recording.health):
            console.print(f'{recording.name}: {note}', style='yellow')
    for notice in identification.notices:
        style = 'bold red' if notice.level == WARNING else 'yellow'
        console.print(f'{notice.level}: {notice}', style=style)


def print_report(
    identification: Identification, console: Console, live: Mapping[str, PartError] = MappingProxyType({})
) -> None:
    """Print data checks, parameters, errors and verdicts; `live` has the errors of `sim_node` by channel."""
    _print_data_checks(identification, console)
    for cylinder, result in identification.cylinders.items():
        for heading, estimates in _reported_gains(cylinder, result):
            console.print(_parameter_table(heading, estimates))
        for note in result.notes:
            console.print(note, style='yellow')
        console.print(_error_table(cylinder, result))
    if identification.no_test is not None:
        console.print(f'No test part: {identification.no_test}.')
    for result in identification.closed:
        _print_findings(result, console)
    for name, error in live.items():
        small_unit = identification.channels[name].quantity.small
        size = f'{error.rmse / small_unit.si:.4g} {small_unit.unit}'
        console.print(f'{name}: sim_node, which computes sample by sample, has an error of {size}.')


def _print_findings(result: ChannelResult, console: Console) -> None:
    """Print the verdict on a channel, its added effects and the candidates."""
    findings = result.findings
    style = _STYLES.get(findings.verdict, 'bold')
    console.print()
    headline = f'{result.name}: {verdict(findings.verdict)}{reservation(findings)}.'
    console.print(Text.assemble((headline, style), ' ', sentence(findings.why)))
    if findings.verdict == 'unexplained':
        console.print(describe_remaining_error(result))
    if result.added:
        console.print(_effect_table(result))
    if findings.tried:
        console.print(_trial_table(result))
    if findings.not_tried:
        console.print(sentence(unfinished(findings)))
    if findings.next_experiment:
        console.print(f'Record next: {findings.next_experiment}.')


def _effect_table(result: ChannelResult) -> Table:
    """Return the table of the added effects with their parameters, and the error before and after."""
    headings = ('effect', 'parameter', 'value', '95 % interval', 'unit')
    effects = table(f'{result.name}: added effects', *headings, words=('effect', 'parameter', 'unit'))
    for effect in result.added:
        for rank, (name, estimate) in enumerate(result.parameters(effect).items()):
            value = 'not identifiable' if estimate.value is None else f'{estimate.value:.4g}'
            interval = (
                '' if estimate.interval is None or not estimate.std else '{:.4g} to {:.4g}'.format(*estimate.interval)
            )
            effects.add_row('' if rank else effect, name, value, interval, estimate.unit)
    effects.caption = _error_ratio(result)
    return effects


def _error_ratio(result: ChannelResult) -> str:
    unit = result.quantity.small.unit
    samples = 'on the test part' if result.judged_on == 'test' else 'on all samples'
    text = f'error {samples}: {result.rmse(0):.4g} {unit} before, {result.rmse(1):.4g} {unit} after'
    if result.findings.ratio is not None and result.findings.ratio_interval is not None:
        low, high = result.findings.ratio_interval
        text += f': {percent(result.findings.ratio)} (95 %: {percent(low)} to {percent(high)})'
    return text


def _trial_table(result: ChannelResult) -> Table:
    """Return the table of candidates that lowered the criterion, a section for each round of the search."""
    headings = ('effect', 'RSS drop', 'delta BIC', f'validation, {result.quantity.small.unit}', 'added', 'why')
    candidates = table(f'{result.name}: candidate effects', *headings, words=('effect', 'added', 'why'))
    shown_count = 0
    for trials in result.findings.rounds:
        shown = [trial for trial in trials if trial.accepted or (trial.delta_bic or 0.0) > _LEAST_BIC]
        shown_count += len(shown)
        for trial in shown:
            candidates.add_row(
                trial.effect,
                percent(trial.rss_drop),
                '' if trial.delta_bic is None else f'{trial.delta_bic:.0f}',
                '' if trial.validation_rmse is None else f'{trial.validation_rmse / result.quantity.small.si:.4g}',
                'yes' if trial.accepted else 'no',
                trial.why,
                end_section=trial is shown[-1],
            )
    hidden_count = len(result.findings.tried) - shown_count
    if hidden_count:
        candidates.caption = f'{hidden_count} more explain nothing. They are listed in the report.'
    return candidates


def _merge_notes(notes: Sequence[str]) -> list[str]:
    """Return notes of the form 'signal: text' with all signals of the same text in one note."""
    signals: dict[str, list[str]] = {}
    for note in notes:
        signal, _, text = note.rpartition(': ')
        signals.setdefault(text, []).append(signal)
    return [f'{", ".join(names)}: {text}' if any(names) else text for text, names in signals.items()]


def _reported_gains(cylinder: str, result: ChannelResult) -> list[tuple[str, Sequence[Estimate]]]:
    """Return each set of gains in `parameters.yaml` with the title of its table."""
    if result.added:
        references = [f'{numbers[0] / 1e3:.1f} kPa absolute' for numbers in result.found.model.core.values()]
        operating_point = references[0] if references else 'every set-point'
        heading = f'{cylinder} at {operating_point}, with {", ".join(result.added)}'
        return [(heading, result.found.estimates[: len(SPECS)])]
    return [
        (f'{cylinder} at {point.setpoint / 1e3:.1f} kPa ({point.setpoint / PSI:.2f} psi) gauge', point.fit.estimates)
        for point in result.schedule
    ]


def _parameter_table(heading: str, estimates: Sequence[Estimate]) -> Table:
    headings = ('parameter', 'value', 'standard error', '95 % interval', 'unit', "in the paper's unit")
    gains = table(heading, *headings, words=('parameter', 'unit'))
    for spec, estimate in zip(SPECS, estimates):
        if estimate.value is None or estimate.std is None or estimate.interval is None:
            gains.add_row(spec.name, 'not identifiable', '', '', '', '')
            continue
        low, high = estimate.interval
        gains.add_row(
            spec.name,
            f'{estimate.value:.4g}',
            f'{estimate.std:.2g}',
            f'{low:.4g} to {high:.4g}',
            spec.unit,
            f'{estimate.value / spec.paper_factor:.4g} {spec.paper_unit}',
        )
    reasons = [f'{name}: {estimate.reason}' for name, estimate in zip(NAMES, estimates) if estimate.reason]
    if reasons:
        gains.caption = '\n'.join(reasons)
    return gains


def _error_table(cylinder: str, result: ChannelResult) -> Table:
    model = ', without effects' if result.found.model.effects else ''
    if result.found.model.core:
        model += ', with the linear core'
    headings = ('part', 'samples', 'RMSE, Pa', 'RMSE, psi', 'NRMSE, % of span')
    errors = table(f'{cylinder}: simulated against measured pressure{model}', *headings, words=('part',))
    for index, part in enumerate(PARTS):
        error = result.before.get(part)
        if error is not None:
            count = sum(int((experiment.part == index).sum()) for experiment in result.experiments)
            errors.add_row(
                part, str(count), f'{error.rmse:.1f}', f'{error.rmse / PSI:.4f}', f'{error.nrmse_percent:.2f}'
            )
    errors.caption = (
        f'span p99 - p1: {result.span:.0f} Pa ({result.span / PSI:.3f} psi); noise floor {result.noise.std:.1f} Pa'
    )
    return errors
