# SPDX-License-Identifier: Apache-2.0
"""Diagnoses of a device, and their changes since it was healthy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cfd_pneumatic.convention import CONTACT_FORCE
from cfd_pneumatic.errors import InputError

if TYPE_CHECKING:
    from cfd_pneumatic.identification import ChannelResult, Estimate, Options
    from cfd_pneumatic.recording import Recording

_SIGNIFICANT = 3.0  # standard errors
_MATERIAL = 0.05  # share of a parameter


@dataclass(frozen=True)
class Diagnosis:
    """
    Result of the closed loop for a signal.

    Attributes
    ----------
    verdict
        One of `verdict.VERDICTS`.
    why
        The verdict in a sentence.
    effects
        Names of effects.
    alternatives
        For each effect the effects that are not distinguishable from it.
    estimates
        Fitted parameters by name.
    characteristic
        What an estimated unknown characteristic does, in a clause; empty without one.

    """

    verdict: str
    why: str
    effects: tuple[str, ...]
    alternatives: Mapping[str, tuple[str, ...]]
    estimates: Mapping[str, Estimate]
    characteristic: str = ''

    @classmethod
    def from_result(cls, result: ChannelResult) -> Diagnosis:
        """Return the diagnosis of a result."""
        conclusion = result.findings
        estimates = {estimate.name: estimate for estimate in result.found.estimates}
        characteristic = '' if conclusion.unknown is None else conclusion.unknown.description
        return cls(
            conclusion.verdict,
            conclusion.why,
            conclusion.effects,
            dict(conclusion.alternatives),
            estimates,
            characteristic,
        )


@dataclass(frozen=True)
class Finding:
    """
    Diagnoses of all signals, or why there are none.

    Attributes
    ----------
    diagnoses
        By `cylinder_a`, `cylinder_b`, `contact_force`.
    failure
        Why there are no diagnoses, or None.
    ended_early
        Whether the process failed, not the recording: the diagnosis is worth repeating.

    """

    diagnoses: Mapping[str, Diagnosis]
    failure: str | None = None
    ended_early: bool = False


def diagnose(recording: Recording, options: Options) -> Finding:
    """Close the loop on a recording, as `identify_bag --close-loop` does."""
    from cfd_pneumatic.identification import identify  # imported in the worker only, so that a watch starts quickly

    try:
        identification = identify([recording], options)
    except InputError as error:
        return Finding({}, str(error))
    return Finding(
        {
            CONTACT_FORCE if result.name == 'force' else result.name: Diagnosis.from_result(result)
            for result in identification.closed
        }
    )


@dataclass(frozen=True)
class NewFindings:
    """
    Changes of a diagnosis since the device was healthy.

    Attributes
    ----------
    effects
        New effects and effects with changed parameters, each with the effects not distinguishable from it.
    estimates
        Their parameters, by `EFFECT.PARAMETER`.
    gains
        Earlier and present estimates of model parameters that have changed.
    unexplained
        Whether a remaining error is not explained by known effects.
    characteristic
        What a new unknown characteristic does, in a clause; empty without one.

    """

    effects: Mapping[str, tuple[str, ...]]
    estimates: Mapping[str, Estimate]
    gains: Mapping[str, tuple[Estimate, Estimate]]
    unexplained: bool
    characteristic: str = ''


def new_findings(present: Diagnosis, before: Diagnosis | None) -> NewFindings:
    """Return the changes of a diagnosis since an earlier diagnosis."""
    earlier = before.effects if before is not None else ()
    known = before.estimates if before is not None else {}
    changed = {name for name, estimate in present.estimates.items() if name in known and _differ(known[name], estimate)}
    effects = {
        effect: present.alternatives.get(effect, ())
        for effect in present.effects
        if effect not in earlier or any(name.startswith(f'{effect}.') for name in changed)
    }
    return NewFindings(
        effects=effects,
        estimates={name: estimate for name, estimate in present.estimates.items() if name.partition('.')[0] in effects},
        gains={name: (known[name], present.estimates[name]) for name in sorted(changed) if '.' not in name},
        unexplained=present.verdict == 'unexplained',
        characteristic='' if before is not None and before.characteristic else present.characteristic,
    )


def _differ(before: Estimate, after: Estimate) -> bool:
    """Return whether two estimates differ significantly and by a material share of the value."""
    if before.value is None or after.value is None or before.std is None or after.std is None:
        return False
    difference = abs(after.value - before.value)
    return difference > _SIGNIFICANT * (before.std**2 + after.std**2) ** 0.5 and difference > _MATERIAL * abs(
        before.value
    )
