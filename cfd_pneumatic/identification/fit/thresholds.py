# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# Ends of a search

ROUGH_SEARCH = (1e-4, 40)
"""
End of a fit that compares starts: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

WEIGHING_SEARCH = (1e-6, 40)
"""
End of a fit that determines the weights of the samples: least relative fall of the sum of squares [-] and most
evaluations [1].
Origin: a fit that only determines weights may end sooner (commit 32f0c9f; 1e-9 and 200 before).
"""

FINE_SEARCH = (1e-9, 60)
"""
End of a fit whose parameters are reported: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known (200 evaluations before commit 32f0c9f).
"""

LARGEST_LOOSENING = 100.0
"""
Largest factor of the least relative fall far above the noise [-]. The factor is the sum of squares over that of the
noise.
Origin: thousandths of a large sum decide nothing; other values were not tried.
"""

LARGEST_LOG_STEP = 2.0
"""Largest step of a logarithm in an iteration [-], a factor of seven. Origin: not known."""

DIFFERENCE_STEP = 1e-5
"""Step of a forward difference [scale of the unknown]. Origin: not known."""

# Damping and bounds of the least squares

FIRST_DAMPING = 1e-3
"""Damping of the first step [-]. Origin: not known."""

LARGEST_DAMPING = 1e12
"""Damping at which a search ends [-]. Origin: not known."""

LEAST_DAMPING_FACTOR = 1.0 / 3.0
"""Least factor on the damping after a step that lowered the sum [-]. Origin: Nielsen (1999)."""

LEAST_SHORTENING = 0.1
"""Least factor on a step that raised the sum [-]. Origin: More (1978)."""

LARGEST_SHORTENING = 0.5
"""Largest factor on a step that raised the sum [-]. Origin: More (1978)."""

LEAST_SCALE = 1e-12
"""
Least diagonal element of the damping [largest diagonal element of the normal matrix].
Origin: the slopes of an unknown with a millionth of another's influence are mostly rounding (commit bf95838).
"""

LEAST_PIVOT = 1e-200
"""
Least largest diagonal element of the normal matrix [its unit]. A matrix of zeros has to be invertible.
Origin: a guard against a singular matrix (commit 406505b).
"""

MOST_ACTIVE_SET_CHANGES = 4
"""Changes of the active set in one step [changes for each unknown]. Origin: not known."""

LEAST_SUM_OF_SQUARES = 1e-300
"""Least sum of squares whose logarithm is taken [its unit]. Origin: a guard against the logarithm of zero."""

LEAST_RMS = 1e-9
"""Least root mean square of a residual that is divided by [signal's unit]. Origin: a guard against division by zero."""

# Excerpts of long recordings

EXCERPT_STEPS = 10_000
"""Excerpt on which the starts of a fit are compared [grid steps]. Origin: not known (50,000 before commit 9b5d721)."""

FULL_EXCERPTS = 4
"""
Experiments whose excerpts have full length [1]. With more experiments each excerpt is shorter.
Origin: many excerpts should hardly take longer than a few. Eighteen measured runs then took 3.4 minutes of processor
time instead of 5.7 (commit 32f0c9f).
"""

FEWEST_EXCERPT_STEPS = 1000
"""Fewest grid steps of an excerpt [grid steps]. Origin: not known."""

STRETCHES = 32
"""
Stretches that represent a long recording in searches and tests [1]. Effects of some seconds may lie between the
stretches.
Origin: the memory of a few arrays as long as the recording (commit c30da50).
"""

STRETCH_SAMPLES = 16_384
"""
Samples of each stretch of a long recording [samples]. Recordings of more than a million samples, twice all stretches,
are read in stretches.
Origin: the memory of a few arrays as long as the recording (commit c30da50).
"""

STRETCH_LEAD = 0.1
"""
Share of a stretch at its beginning that does not count [-]. The temperature of the air is not known there.
Origin: not known.
"""

SHORT_STRETCHES = 8
"""
Short stretches that represent all motion of a recording [1].
Origin: 16 stretches, half as long, had 1.3 times the residual of the whole recording on a healthy device. 8 stretches
have the residual of the whole recording (commit 38eaa26).
"""

SHORT_STRETCH_LEAD = 0.25
"""
Share of a short stretch at its beginning that does not count [-]. The temperature of the air is not known there.
Origin: measured together with `SHORT_STRETCHES` (commit 38eaa26).
"""

# Identifiability and intervals

CONFIDENCE = 0.95
"""Confidence of intervals, and of the test whether data sheets suffice [-]. Origin: not known."""

LARGEST_RELATIVE_STD = 1.0 / 3.0
"""
Largest standard error of an identifiable parameter [value of the parameter].
Origin: with larger standard errors zero is within three standard errors.
"""

LARGEST_SPREAD_RATIO = 0.7
"""
Largest standard error of an estimate [prior spread of the parameter]. With a larger error the recordings do not
determine the parameter.
Origin: not known.
"""

LEAST_BOUND_DISTANCE = 1e-3
"""Least distance of an identifiable unknown from its bounds [logarithm or scale of the unknown]. Origin: not known."""

LEAST_SINGULAR_VALUE = 1e-4
"""
Least singular value of a combination of unknowns that the recordings determine [largest singular value].
Origin: not known.
"""

LEAST_DETERMINED = 1e-14
"""
Least eigenvalue of the normal matrix that is inverted [largest eigenvalue]. Smaller eigenvalues are rounding.
Origin: not known.
"""

LARGEST_NULL_DISTANCE = 2.0
"""
Largest distance from null of a parameter that may be held at its data-sheet value [standard errors].
Origin: saves a search over Wald's test on growing sets, with the same coverage (commit 746b9d9).
"""

LARGEST_PRESSURE_RATIO = 1.5
"""
Largest ratio of the gauge pressures of recordings for which one set of gains holds [-]. Recordings at 1 to 7 bar had
residuals that looked like steps (commit f10d95a).
Origin: not known.
"""

# Correlation of the residual

LEAST_CORRELATION = 3.0
"""Least correlation of residuals that counts [standard deviations of the correlation of noise]. Origin: not known."""

FINEST_LAGS = 64
"""
Lags up to which the window of Newey and West is computed from single samples [samples]. Longer windows use sums of
adjacent samples.
Origin: the length of the window then is exact to a few percent (commit 1f99ac2).
"""
