# SPDX-License-Identifier: Apache-2.0
"""
Check whether units, references, signs, columns, sensors and clocks of recordings are plausible.

`check_recordings` uses the recordings alone. `check_results` also uses the identified results.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.input_checks.alternative_readings import alternative_reading, is_misread
    from cfd_pneumatic.identification.input_checks.recordings import (
        check_recording,
        check_recordings,
        describe,
        hides_effects,
    )
    from cfd_pneumatic.identification.input_checks.results import check_results
    from cfd_pneumatic.identification.input_checks.sensor_ripple import ripple_notice, ripple_of
    from cfd_pneumatic.identification.input_checks.setpoint_steps import steps_of_fit, steps_of_pressure
else:
    __getattr__ = loader_of(__name__)
