# SPDX-License-Identifier: Apache-2.0
"""What to do next where something was not identifiable or could not have shown: plan an experiment for it."""

from __future__ import annotations

import shlex
from pathlib import Path

from cfd_pneumatic.identification import Identification
from cfd_pneumatic.model import EFFECTS, NAMES
from cfd_pneumatic.reporting.names import PARAMETER_FILE, REPORT_FILE

_NEXT = 'next'  # folder of the plan, beside the results


def next_plan(identification: Identification, folder: Path = Path()) -> str | None:
    """
    Return the command that plans an experiment for what these recordings did not tell; None where they told all.

    None, too, where recordings are misread: they may tell it, read as they should be.

    `folder` is where the results are, as seen from where the command is to be run.
    """
    if not all(result.findings.is_searched for result in identification.closed):
        return None
    unidentifiable = {
        estimate.name
        for result in identification.cylinders.values()
        for point in result.schedule
        for estimate in point.fit.estimates
        if not estimate.identifiable
    }
    hidden = {name for result in identification.closed for name in result.findings.not_visible}
    wanted = [name for name in (*NAMES, *EFFECTS) if name in unidentifiable | hidden]
    if not wanted:
        return None
    parameters, report, output = (folder / name for name in (PARAMETER_FILE, REPORT_FILE, _NEXT))
    return shlex.join(
        ['plan_experiment', str(parameters), '--report', str(report), '--output', str(output), '--wanted', *wanted]
    )
