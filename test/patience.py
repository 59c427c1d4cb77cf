# SPDX-License-Identifier: Apache-2.0
"""How long tests wait: limits for an idle machine, which grow with the load of the one that runs them."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

PATIENCE = 180.0
"""For anything to happen [s]; a third of it is what the compiler of the model takes."""

LONG_PATIENCE = 600.0
"""For a fit, or a plant [s]."""


def allowed(seconds: float = PATIENCE) -> float:
    """Return a time limit [s]: that of an idle machine, times the processes that share each core now."""
    return seconds * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def wait_until(
    condition: Callable[[], Any],
    *,
    seconds: float = PATIENCE,
    meanwhile: Callable[[], Any] = lambda: time.sleep(0.05),
    found: Callable[[], Any] = lambda: 'nothing of the kind',
) -> Any:
    """
    Return what the condition gives as soon as it is true; do something meanwhile, again and again.

    The limit grows if the load rises. `found` says what there was instead.
    """
    begin = time.monotonic()
    while not (result := condition()):
        assert time.monotonic() - begin < allowed(seconds), f'waited for {time.monotonic() - begin:.0f} s: {found()}'
        meanwhile()
    return result
