# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# Fits on parts of a recording: part_fits.py

SETTLING_TIME = 0.3
"""
Time at the start of a recording that does not count [s]. The first pressure is only known if the piston rests.
Origin: not known.
"""

PART_SEARCH = (1e-4, 30)
"""
End of a fit to a part: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

COMPARED_STARTS_SEARCH = (1e-4, 40)
"""
End of a fit that compares starts: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: `fit.thresholds.ROUGH_SEARCH`.
"""

EXCERPT_STEPS = 10_000
"""Excerpt on which the starts of a fit are compared [grid steps]. Origin: `fit.thresholds.EXCERPT_STEPS`."""

MOST_COMPARED_STEPS = 60_000
"""
Grid steps up to which a whole recording is compared; of a longer recording stretches are compared [steps].
Origin: two minutes at 500 Hz, so that the comparison takes some seconds.
"""

SHORTEST_DRIFT = 10.0
"""
Time per degree of the polynomial that counts as a slow drift [s]. Quicker changes overlap with single strokes.
Origin: a polynomial of degree 6 in 6 s hid a jump of the set-point of 750 Pa.
"""

LARGEST_DRIFT_DEGREE = 6
"""
Largest degree of the polynomial of the time that counts as a slow drift of sensor or set-point [1].
Origin: an exponential drift with a time constant of a fifth of the recording must be no change.
"""

DRIFT_ROUNDS = 2
"""
Rounds of a fit and the removal of the drift [1]. The drift misleads the gains of the first fit.
Origin: not known.
"""

LEAST_VARIANCE = 1e-12
"""Least mean square of a residual before its logarithm [Pa^2]. Origin: a guard against the logarithm of zero."""

# Detection: detection.py

FIRST_CUTS = (0.25, 0.5, 0.75)
"""
Shares of a recording at which the search for the time of a change begins [share of the samples].
Origin: not known.
"""

MOST_CUT_REVISIONS = 5
"""Most revisions of the time of a change from one first cut [1]. Origin: not known."""

LEAST_SIDE = 0.12
"""
Least share of a recording before and after a change [share of the samples]. A shorter part is not identifiable.
Origin: not known.
"""

LEAST_DROP = 0.3
"""
Least fall of the mean logarithm of the squared error for a change [1], compared with the best explanation by the
excitation. The largest fall of a healthy device was 0.09.
Origin: healthy devices of the panel and devices with foreign equations, seeds below 1000.
"""

UNKNOWNS_OF_PART = 5
"""
Unknowns of a part [1]: four gains and an offset. They explain this share of the squared error by chance, per stroke.
Origin: the number of unknowns.
"""

LEAST_RMS_OVER_NOISE = 1.1
"""
Least error of a single model for a search for a change [standard deviations of the noise].
Origin: the errors of healthy devices of the panel are below 1.05.
"""

# Drift: drift.py

LEAST_DRIFT_DROP = 0.25
"""
Least fall of the mean logarithm of the squared error for a bent drift [1], compared with a straight drift.
Healthy devices and devices with a straight drift reach 0.11, devices with an exponential drift 0.41 to 0.58.
Origin: devices with foreign equations, seeds 1 to 3.
"""

# Excitation that may explain an error: excitation.py

EXCITATION_QUANTILES = (0.25, 0.5, 0.75)
"""Quantiles of an excitation at which samples are divided into two groups [-]. Origin: not known."""

LEAST_GROUP = 0.05
"""Least share of the samples in a group [-]. Origin: not known."""

AMPLITUDE_WINDOW = 1.0
"""Window of the amplitude and the mean speed of the motion [s]. Origin: not known."""

# Time of a change: detection.py

LARGEST_COST_RISE = 1.92
"""
Rise of the negative log likelihood at the ends of a 95 % interval [1].
Origin: half of chi squared with one degree of freedom.
"""

INTERVAL_MARGIN = 0.05
"""
Widening of the interval at either end for errors of the models [s].
Origin: the time of a kinked hose on ten rigs erred by up to 0.03 s, and five intervals without margin missed it.
"""

DEGREES_OF_INNOVATIONS = 4.0
"""Degrees of freedom of Student's distribution of the innovations [1]. Origin: not known."""

NORMAL_PER_MEDIAN = 1.4826
"""Standard deviation of a normal distribution [median absolute deviations]. Origin: the normal distribution."""

EVENT_POINTS = 2
"""
Points within which a curve of the time varies at a change [points of the curve].
Origin: a twentieth of the time (commit 5c4d339).
"""

LEAST_EVENT_SHARE = 0.6
"""
Least variation of a curve of the time at a change [range of the curve].
Origin: a set-point that jumps makes most of the variation, a pressure that creeps at most two fifths (commit 5c4d339).
"""

# Difference of the parts: change.py

LEAST_STANDARD_ERRORS = 3.0
"""Least difference of an estimate that differs between two parts [standard errors]. Origin: not known."""

MODEL_ERROR = 0.1
"""
Error of an estimate by errors of the model, in addition to its standard error [share of the estimate].
Origin: the gains of halves of healthy recordings of the rig with full physics differ by up to 12 % (linear core).
"""
