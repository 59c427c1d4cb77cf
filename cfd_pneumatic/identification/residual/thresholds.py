# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# Significance

SIGNIFICANCE = 0.001
"""
Chance with which a test of a residual, the one on the test part included, fails although nothing is missing [-].
Origin: not known.
"""

SHIFT_SIGNIFICANCE = 0.005
"""
Share of the circular shifts whose inputs may explain more of the residual than the inputs at their times [-].
Origin: not known.
"""

NOISE_ALLOWANCE = 3.0
"""
Allowance for the uncertainty of the noise [standard errors]. It raises the limits of size and autocorrelation.
Origin: not known.
"""

# Deviations that a test tolerates

LARGEST_EXPLAINED = 0.04
"""Largest share of the residual's variance that inputs may explain beyond chance [-]. Origin: not known."""

LARGEST_EXPLAINED_NOISE = 0.08
"""
Largest share of the noise's variance that inputs may explain beyond chance, for a model with core or effects [-].
Origin: 4 % of the noise's size, because the equations of core and effects are approximations (commit 851b74e).
"""

LARGEST_SQUARED_CORRELATION = 0.04
"""Largest sum of squared autocorrelations of the residual beyond chance [-]. Origin: not known."""

LARGEST_SLOW_SHARE = 0.015
"""Largest share of the residual's power in its slowest ordinates [-]. Origin: not known."""

LARGEST_LINE_SHARE = 0.01
"""
Largest share of the residual's power in one line of the spectrum [-].
Origin: lines of a thousandth of the power failed the test in long records. Of twelve minutes of the rig with a leak,
seven ended as unexplained (commit 8dd0420).
"""

LARGEST_SIZE_RATIO = 1.10
"""Largest residual of short records [standard deviations of the noise]. Origin: not known."""

LARGEST_SIZE_RATIO_LONG = 1.05
"""
Largest residual of long records, from `LONG_RECORD` samples on [standard deviations of the noise].
Origin: not known.
"""

LONG_RECORD = 5000
"""Samples from which a record is long in the test of the size [samples]. Origin: not known."""

ROUNDING_ALLOWANCE = 1.25
"""
Factor on the largest residual if the noise is mostly rounding [-]. The noise that is rounded adds to the
rounding.
Origin: not known.
"""

# Regression on the inputs

REGRESSOR_LAGS = (0, -1, 1, -2, 2, 4, 8, 16, 32)
"""Lags of the regressors [samples]. Short records omit the last lags first. Origin: not known."""

FEWEST_SAMPLES_PER_REGRESSOR = 10
"""Fewest samples for each regressor [samples]. Origin: not known."""

REGRESSOR_CHUNK = 16_384
"""Samples whose regressors are computed together [samples]. The limit keeps memory small. Origin: not known."""

MOST_REGRESSED_SAMPLES = 60_000
"""Samples of the regression on the inputs [samples]. Longer records are read in stretches. Origin: not known."""

REGRESSION_STRETCH = 2000
"""
Stretch of a long record in the regression on the inputs [samples]. It is long compared with all lags.
Origin: the largest of `REGRESSOR_LAGS` (commit 78f70d0).
"""

LEAST_SINGULAR_VALUE = 1e-6
"""Least singular value of regressors that count as independent [largest singular value]. Origin: not known."""

MOST_SLOW_SAMPLES = 4096
"""Samples to which long records are averaged for slow parts [samples]. Origin: not known."""

# Spectrum

SLOW_ORDINATES = 4
"""Slowest ordinates of the spectrum, which determine the level [ordinates]. Origin: not known."""

LEVEL_ORDINATES = 48
"""
Ordinates, counted from the slowest, up to which the level is compared with the spectrum [ordinates].
Origin: not known.
"""

LINE_WINDOW = 61
"""Window of the median that a line of the spectrum is compared with [ordinates]. Origin: not known."""

LINE_ALLOWANCE = 1.3
"""
Factor on the significant height of a line [-]. The median of the adjacent ordinates scatters and widens the
distribution.
Origin: not known.
"""

# Autocorrelation of the residual

LJUNG_BOX_LAGS = 25
"""Lags of Ljung and Box's test [samples]. Origin: not known."""

LJUNG_BOX_SIMULATIONS = 100
"""Simulations of noise that determine the significant autocorrelation [1]. Origin: not known."""

LJUNG_BOX_QUANTILE = 4.0
"""Significant autocorrelation, above the mean of the simulations [standard deviations]. Origin: not known."""

LONGEST_SIMULATED = 5000
"""Most samples of a record in the test of the autocorrelation [samples]. Origin: not known."""

SIMULATION_LEAD = 200
"""Samples of simulated noise before those that count [samples]. The start at rest is forgotten. Origin: not known."""

# Noise of the sensor

NOISE_PIECE = 500_000
"""
Piece of a long signal whose noise is estimated at once [samples]. The limit keeps memory small.
Origin: not known.
"""

KEPT_DIFFERENCES = 0.9
"""
Share of the differences of adjacent samples, the smallest ones, that counts as noise [-]. Larger differences may be
transients.
Origin: not known.
"""

LARGEST_COLOURED_NOISE = 6.0
"""
Largest noise of a sensor [standard deviations of its white part]. Larger residuals at rest are no noise. Without
rests the residual may be as large.
Origin: noise that is correlated over 25 samples (commit 387ab95).
"""

LEAST_COLOURED_NOISE = 1.1
"""Least residual at rest of coloured noise [standard deviations of the white part]. Origin: not known."""

FEWEST_SAMPLES_AT_REST = 100
"""Fewest samples at rest that determine the noise [samples]. Origin: not known."""

INDEPENDENT_DISTANCE = 50
"""
Distance of samples whose noise is independent [samples].
Origin: longer than the correlation of a sensor's noise (commit bf95838).
"""

LEAST_ROUNDING = 0.6
"""Least rounding of a signal whose noise is mostly rounding [standard deviations of the noise]. Origin: not known."""

LARGEST_DISTINCT_SHARE = 0.5
"""Largest share of distinct values in a signal whose rounding shows [-]. Origin: not known."""

LEAST_ROUNDING_STEP = 1e-6
"""Least step of a converter [share of the span of the signal]. Smaller steps are rounding errors. Origin: not known."""

# Autoregression

HIGHEST_ORDER = 12
"""Highest order of an autoregression [1]. Origin: not known."""

FEWEST_SAMPLES_PER_ORDER = 20
"""Fewest samples for each order of an autoregression [samples]. Origin: not known."""

LONGEST_RESPONSE = 2000
"""Length of the impulse response from which the independent samples are counted [samples]. Origin: not known."""

LEAST_INDEPENDENT_SHARE = 1e-3
"""Least share of independent samples in autoregressive noise [-]. Origin: not known."""

LEAST_INNOVATION = 1e-300
"""
Least variance that is divided by, or whose logarithm is taken [signal's unit squared].
Origin: a guard against zero.
"""

# Rests

REST_SETTLING_TIME = 0.15
"""Time after a motion from which a pressure is at rest [s]. Origin: not known."""

LARGEST_REST_MOTION = 1e-3
"""Largest motion at rest [share of the range of the displacement]. Origin: not known."""

FEWEST_REST_SAMPLES = 30
"""Fewest samples of a rest [samples]. Origin: not known."""

# Frequency, lag and speed

HIGHEST_SUPPLY_FREQUENCY = 3.0
"""Highest frequency of a supply's variation [Hz]. Origin: not known."""

MOST_FREQUENCIES = 100
"""Frequencies, the strongest of the periodogram, that are compared closely [1]. Origin: not known."""

FEWEST_ORDINATES = 1024
"""Fewest samples of the padded series whose periodogram is computed [samples]. Origin: not known."""

AVERAGING_TIME = 0.05
"""
Time over which residuals are averaged before the search for a frequency [s].
Origin: short compared with the period of `HIGHEST_SUPPLY_FREQUENCY` (commit bf95838).
"""

LARGEST_LAG = 0.2
"""Largest lag between a measured and a simulated signal [s]. Origin: not known."""

STEP_RESPONSE_TIME = 0.5
"""
Longest time after a step of the set-point in which the response is compared with the model [s].
Origin: the upper bound of the delay in `setpoint_delay`.
"""

LEAST_SPEED = 1e-5
"""Least speed that is reported of a moving piston [m/s]. Origin: not known."""

LEAST_DURATION = 1e-9
"""Least duration that is divided by [s]. Origin: a guard against division by zero."""
