# SPDX-License-Identifier: Apache-2.0
"""The next experiment: the command that plans it for parameters and effects that the recordings did not determine."""

from __future__ import annotations

import shlex
from pathlib import Path

from cfd_pneumatic.identification import Identification
from cfd_pneumatic.model import EFFECTS, NAMES
from cfd_pneumatic.reporting.names import PARAMETER_FILE, REPORT_FILE

_PLAN_FOLDER = 'next'  # folder of the plan, next to the results


def next_plan(identification: Identification, folder: Path = Path()) -> str | None:
    """
    Return the command that plans the next experiment, or None if no experiment is needed.

    The experiment is for unidentifiable parameters and for effects that these recordings could not show. The result is
    also None if recordings are likely misread: correctly read, they may determine everything.

    `folder` is the folder of the results, relative to the folder in which the command is run.
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
    invisible = {name for result in identification.closed for name in result.findings.not_visible}
    wanted = [name for name in (*NAMES, *EFFECTS) if name in unidentifiable | invisible]
    if not wanted:
        return None
    parameters, report, output = (folder / name for name in (PARAMETER_FILE, REPORT_FILE, _PLAN_FOLDER))
    return shlex.join(
        ['plan_experiment', str(parameters), '--report', str(report), '--output', str(output), '--wanted', *wanted]
    )
