# SPDX-License-Identifier: Apache-2.0
"""What the loop makes of a stretch of a device's signals, and what is new in it against an earlier stretch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cfd_pneumatic.convention import CONTACT_FORCE
from cfd_pneumatic.errors import InputError

if TYPE_CHECKING:
    from cfd_pneumatic.identification import ChannelResult, Estimate, Options
    from cfd_pneumatic.recording import Recording

_SURE = 3.0  # standard errors
_MATERIAL = 0.05  # share of a parameter


@dataclass(frozen=True)
class Diagnosis:
    """
    What the loop ended with on one signal.

    Attributes
    ----------
    verdict
        One of `verdict.VERDICTS`.
    why
        It in a sentence.
    effects
        Names of effects.
    alternatives
        For each effect those that can't be told from it.
    estimates
        What was fitted, by name.
    law
        What a law does that was drawn, in a clause; empty where none was.

    """

    verdict: str
    why: str
    effects: tuple[str, ...]
    alternatives: Mapping[str, tuple[str, ...]]
    estimates: Mapping[str, Estimate]
    law: str = ''

    @classmethod
    def of(cls, result: ChannelResult) -> Diagnosis:
        """Return what is kept of a result."""
        conclusion = result.findings
        estimates = {estimate.name: estimate for estimate in result.found.estimates}
        law = '' if conclusion.unknown is None else conclusion.unknown.description
        return cls(
            conclusion.verdict, conclusion.why, conclusion.effects, dict(conclusion.alternatives), estimates, law
        )


@dataclass(frozen=True)
class Finding:
    """
    What the loop ended with on each signal, or why it could not be closed.

    Attributes
    ----------
    found
        By `cylinder_a`, `cylinder_b`, `contact_force`.
    failure
        Why there is nothing, or None.
    ended_early
        Whether the failure is of the process and not of the recording: the diagnosis is worth repeating.

    """

    found: Mapping[str, Diagnosis]
    failure: str | None = None
    ended_early: bool = False


def diagnose(recording: Recording, options: Options) -> Finding:
    """Close the loop on a recording, as `identify_bag --close-loop` does."""
    from cfd_pneumatic.identification import identify  # in the worker: a watch does not wait for it at its start

    try:
        identification = identify([recording], options)
    except InputError as error:
        return Finding({}, str(error))
    return Finding(
        {
            CONTACT_FORCE if result.name == 'force' else result.name: Diagnosis.of(result)
            for result in identification.closed
        }
    )


@dataclass(frozen=True)
class News:
    """
    What is new in a finding.

    Attributes
    ----------
    effects
        Effects that are new, or have other parameters than before, with those that can't be told from each.
    estimates
        Their parameters, by `EFFECT.PARAMETER`.
    gains
        Before and after, of the model's own parameters that have changed.
    unexplained
        Whether something is left that no effect explains.
    law
        What a law does that was drawn, where none was before.

    """

    effects: Mapping[str, tuple[str, ...]]
    estimates: Mapping[str, Estimate]
    gains: Mapping[str, tuple[Estimate, Estimate]]
    unexplained: bool
    law: str = ''


def news(found: Diagnosis, before: Diagnosis | None) -> News:
    """Return what is new in what was found, against what was found before the device parted from its model."""
    earlier = before.effects if before is not None else ()
    known = before.estimates if before is not None else {}
    changed = {name for name, one in found.estimates.items() if name in known and _differ(known[name], one)}
    effects = {
        effect: found.alternatives.get(effect, ())
        for effect in found.effects
        if effect not in earlier or any(name.startswith(f'{effect}.') for name in changed)
    }
    return News(
        effects=effects,
        estimates={name: one for name, one in found.estimates.items() if name.partition('.')[0] in effects},
        gains={name: (known[name], found.estimates[name]) for name in sorted(changed) if '.' not in name},
        unexplained=found.verdict == 'unexplained',
        law='' if before is not None and before.law else found.law,
    )


def _differ(before: Estimate, after: Estimate) -> bool:
    """Return whether two estimates are of different values, by more than their errors and more than a little."""
    if before.value is None or after.value is None or before.std is None or after.std is None:
        return False
    apart = abs(after.value - before.value)
    return apart > _SURE * (before.std**2 + after.std**2) ** 0.5 and apart > _MATERIAL * abs(before.value)
