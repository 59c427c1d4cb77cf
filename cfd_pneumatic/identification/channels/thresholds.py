# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# The contact force: force.py

LARGEST_AREA_RATIO = 1.5
"""Largest ratio between the area of a fit and the area that it begins from, either way [-]. Origin: not known."""

LEAST_LEVEL_GAP = 0.03
"""
Least distance of two set-points that determine the area better than one does [share of the pressure].
Origin: not known.
"""

SMOOTHED_SAMPLES = 25
"""Samples of a moving mean for the regressors [samples]. Origin: not known."""

SLOW_SHARE = 0.05
"""
Share of the standard deviation of the speed below which friction takes the piston to be at rest [-].
Origin: not known.
"""

ROUGH_ACCELERATION_SHARE = 0.3
"""
Largest deviation of an acceleration from the mean of those around it [share of the acceleration].
Origin: not known.
"""

TIED_STANDARD_ERRORS = 3.2
"""
Standard errors up to which a change cannot be distinguished from a tie [standard errors].
Origin: the criterion then changes by as little as between tied effects.
"""

PRESLIDING_STARTS = (5e-5, 5e-4)
"""Pre-sliding displacements from which the fit of a friction characteristic starts [m]. Origin: not known."""

LEAD_SAMPLES = 5
"""Samples before a stroke into which a smoothed acceleration reaches [samples]. Origin: not known."""

# The pressure of a cylinder: pressure.py

LARGEST_PRESSURE = 1e9
"""Largest recorded pressure that is not refused [Pa]. Origin: not known."""

LEAST_FLOW_LIMIT = 10.0
"""Least flow from which a flow limit starts [Pa/s]. Origin: not known."""

LEAST_PISTON_EVIDENCE = 40.0
"""
Least rise of twice the log likelihood if the model follows the piston [1].
Origin: noise alone stays below.
"""

LARGEST_RATE_PER_SAMPLE = 100.0
"""
Largest product of a rate of the model and the sample period [1].
Origin: quicker models become unstable in the steps of the kernel.
"""

EXACT_EFFORT = 0.5
"""
Effort of the exact simulation with its derivatives [step of Runge and Kutta with an effect].
Origin: processor times of a single recording, measured without a script.
"""

PHYSICAL_EFFORT = 2.2
"""
Additional effort of the physical core [step of Runge and Kutta with an effect].
Origin: as for `EXACT_EFFORT`.
"""

CURVE_EFFORT = 1.4
"""
Additional effort of a curve [step of Runge and Kutta with an effect].
Origin: as for `EXACT_EFFORT`.
"""

LINEARISED_PERIODS = 1.5
"""
Sample periods of the quickest model of which small changes are computed [sample periods].
Origin: a quicker model hardly differs.
"""

SENSED_START_TIME = 0.03
"""Time after which an unknown sensed pressure at the start has no influence [s]. Origin: not known."""

SHORTEST_GAP = 1e-9
"""Least interval between two samples that counts as time [s]. Origin: not known."""

SHORTEST_STROKE = 1e-5
"""Least stroke over which effects along the stroke are tried [m]. Origin: not known."""

LEAST_LEVEL_RATIO = 1.01
"""Least ratio of the highest to the lowest set-point for a dependence on the pressure [-]. Origin: not known."""

LARGEST_START_DISTANCE = 3.0
"""Largest distance of an initial pressure from the set-point [range of the pressure]. Origin: not known."""

FLOW_LAG_STARTS = (0.03, 0.1, 0.3)
"""Lags of the flow from which the fit of a characteristic of the flow starts [s]. Origin: not known."""

SLACK_AT_REST = 6.0
"""Range of the displacement at rest [standard deviations of its noise]. Origin: not known."""

# Bounds of unknowns: unknown.py

LEAST_LAG_SHARE = 0.15
"""
Least time constant of a lag [sample periods].
Origin: samples cannot show a quicker lag, and its steps would cost time.
"""

LARGEST_FREQUENCY = 0.5
"""
Largest frequency of an oscillation [1 / sample period].
Origin: the Nyquist frequency; a quicker oscillation passes for a slower one.
"""

FEWEST_PERIODS = 0.5
"""
Fewest periods of an oscillation in the longest experiment [1].
Origin: fewer cannot be distinguished from a drift.
"""

END_SHARE = 0.1
"""
Distance of a place from the ends of the stroke [share of the stroke].
Origin: a place closer to an end has data on one side only.
"""

LARGEST_WIDTH_SHARE = 0.5
"""Largest width over which an opening opens and shuts [share of the stroke]. Origin: not known."""

LEAST_SUPPLY_RATIO = 1.05
"""
Least ratio of the supply pressure to the highest recorded pressure [-].
Origin: a valve with less supply would hardly pass air.
"""

# Sizes of a characteristic: characteristics.py

LARGEST_BORE_CHANGE = 0.5
"""
Largest change of the volume that a piston sweeps, along the stroke or over the pressure [share]. A larger change is no
bore.
Origin: not known.
"""

LARGEST_STIFFNESS_CHANGE = 3.0
"""
Largest change of the air's stiffness [share]: the stiffness is the inverse of the volume, which may fall to a quarter.
Origin: not known.
"""

LARGEST_CELL_CHANGE = 0.5
"""Largest change of a load cell's reading [share]. Origin: not known."""
