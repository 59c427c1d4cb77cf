# SPDX-License-Identifier: Apache-2.0
"""Thresholds of predictions along a path: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# Motion: motion.py

PERIOD = 2e-3
"""
Period of the grid on which a path is simulated [s].
Origin: the sampling period of the rig.
"""

REST = 0.5
"""
Rest of the piston before and after a path [s].
Origin: chosen; ten times the longest time constant of the paper, 50 ms.
"""

LONGEST_PATH = 600.0
"""
Longest path that is simulated [s].
Origin: chosen; 300,000 samples.
"""

LARGEST_EXCESS = 0.1
"""
Largest distance of a path from the identified stroke, as a share of the stroke [-].
Origin: not known.
"""

# Set-points: setpoints.py

CENTRED = 1e-3
"""Remaining mean error of centred set-points, as a share of the force [-]. Origin: chosen."""

MOST_CORRECTIONS = 8
"""Most corrections of the set-points [1]. Origin: chosen."""

# Band: band.py

STANDARD_ERRORS = 1.96
"""Half of the band in standard errors [1]. Origin: 95 % of a normal distribution."""

DEVIATION = 0.01
"""
Change of the parameters with which the band is computed [standard deviations].
Origin: chosen; parameters that a recording hardly determines compensate each other to first order only.
"""

SCAN_LENGTH = 5e-3
"""
Distance over which the error of a scan of the surface changes [m].
Origin: chosen, for the spot and the smoothing of a line scanner.
"""

SCAN_TIME = 0.05
"""
Time over which the error of a displacement that is given over time changes [s].
Origin: `SCAN_LENGTH` at a feed of 0.1 m/s.
"""

SCANS = 8
"""Random scans from which the effect of a scan's error is estimated [1]. Origin: its error is then a quarter."""

# Feed: feed.py

FASTEST_FEED = 10.0
"""Fastest feed that is searched [m/s]. Origin: chosen."""

SLOWEST_SHARE = 1.0 / 16.0
"""
Slowest feed that is searched, as a share of the wanted feed [-].
Origin: chosen; slower paths take longer to simulate, and friction remains at any feed.
"""

FEED_TOLERANCE = 0.01
"""End of the search for a feed, as a share of the feed [-]. Origin: chosen."""

# Set-points that hold the force: hold.py

FASTEST_RATE = 250.0
"""
Fastest rate of set-points [Hz].
Origin: half of the rate of the grid.
"""

MOST_ITERATIONS = 8
"""Most iterations of the inversion between two measurements of the responses [1]. Origin: chosen."""

MOST_MEASUREMENTS = 3
"""
Most measurements of the responses [1].
Origin: chosen; with the responses at constant set-points alone, the iteration stopped early on device 2000 of
`studies.hold`.
"""

STEP_SHARES = (1.0, 0.5, 0.25)
"""Shares of a step that are tried in turn [-]. Origin: a whole step overshoots where the other valve begins to act."""

LEAST_GAIN = 0.02
"""
Least relative fall of the force error for which the inversion continues [-].
Origin: chosen.
"""

SETTLING_TIME_CONSTANTS = 4.0
"""Time constants in which the response to a change of a set-point ends [1]. Origin: 2 % remain."""

LONGEST_RESPONSE = 1.0
"""
Longest response to a change of a set-point that is measured [s].
Origin: chosen; twenty times the longest time constant of the paper.
"""

CHANGE = 500.0
"""
Change of a set-point with which the response is measured [Pa].
Origin: chosen.
"""

SMOOTHNESS = 1e-3
"""
Weight of the change between adjacent set-points, relative to the response of the pressure [-].
Origin: not known.
"""

LATEST = 0.5
"""Largest delay of the set-points that is tried [s]. Origin: chosen."""

# Texts: texts.py

MOST_PLACES = 4
"""Most places of a violation that a text lists [1]. Origin: a line of the terminal."""
