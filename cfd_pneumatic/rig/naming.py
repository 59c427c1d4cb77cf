# SPDX-License-Identifier: Apache-2.0
"""Schedules by what people call them: a name, or a file that holds one."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from pathlib import Path

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig.schedule import Schedule, out_and_back, paper_step, surface_following
from cfd_pneumatic.rig.written import SUFFIX, written_schedule

SCHEDULES: dict[str, Callable[..., Schedule]] = {
    builder.__name__: builder for builder in (paper_step, out_and_back, surface_following)
}
"""The schedules by name."""


def schedule_named(name: str, **options: float) -> Schedule:
    """
    Return a schedule by its name, or from a file that `plan_experiment` wrote.

    Raises
    ------
    InputError
        If there is no such schedule, or it has no such option.

    """
    builder = partial(written_schedule, Path(name)) if name.endswith(SUFFIX) else SCHEDULES.get(name)
    if builder is None:
        raise InputError(f'schedule {name!r} is not known: use one of {", ".join(SCHEDULES)}, or a file *{SUFFIX}')
    known = inspect.signature(builder).parameters
    for option in options:
        if option not in known:
            raise InputError(f'schedule {name!r} has no option {option!r}: it takes {", ".join(known)}')
    return builder(**options)
