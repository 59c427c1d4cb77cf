# SPDX-License-Identifier: Apache-2.0
"""Thresholds of the modules directly in this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# Recordings as a whole: procedure.py

MOST_SAMPLES_TOGETHER = 1_000_000
"""
Displacement samples up to which channels are identified in parallel [samples]. Parallel channels need more memory.
Origin: not known.
"""

# Operating points: operating_points.py

LARGEST_SETPOINT_GAP = 0.03
"""Largest gap between adjacent set-points of one operating point [absolute pressure]. Origin: not known."""

# Progress and limit of a search: progress.py

LARGEST_EFFORT = 14e6
"""
Largest effort of a channel's search, in addition to `LARGEST_EFFORT_PER_STEP` [simulated steps].
Origin: the times in docs/measurements/foreign.md.
"""

LARGEST_EFFORT_PER_STEP = 150.0
"""
Largest effort of a channel's search for each step of its recordings [simulated steps].
Origin: see `LARGEST_EFFORT`.
"""

LEAST_PROGRESS = 0.01
"""Least change of the completed share that is reported [-]. Origin: a bar has about 100 characters."""

# Verdict: conclusion.py

FEWEST_TRAIN_SAMPLES = 100
"""
Fewest samples of the train part for a search for effects [samples]. The search has a dozen unknowns and a noise floor.
Origin: the number of unknowns (commit bf95838).
"""

LARGEST_CHANCE_RATIO = 0.9
"""
Largest error ratio on the test part, with 1 in its interval, at which effects are reported although more than noise
remains [-].
Origin: a delay was named that reduced the error of a foreign device to 99 % (98 to 101 %).
"""

LARGEST_EXPLAINED_RATIO = 1.1
"""
Largest residual at which core, effects or a curve remain the answer although the residual depends on an input [standard
deviations of the noise].
Origin: such a dependence has less than half of the noise's size.
"""

LARGEST_RATIO_WITHOUT_RESTS = 1.25
"""
Largest residual that counts as noise in a recording without rests [standard deviations of the noise from sample to
sample]. The noise of most sensors is smaller.
Origin: not known.
"""

MOST_CORE_BOUNDS = 1
"""
Most parameters of the physical core at a bound, apart from those that the bound switches off, with which the core is
reported as found [1].
Origin: not known.
"""

BOOTSTRAP_BLOCKS = 20
"""Blocks of the bootstrap of the error ratio [1]. Origin: not known."""

BOOTSTRAP_RESAMPLINGS = 2000
"""Resamplings of the bootstrap of the error ratio [1]. Origin: not known."""

BOOTSTRAP_QUANTILES = (0.025, 0.975)
"""Quantiles of the error ratio that bound its interval of 95 % [-]. Origin: not known."""

# Test part: test_part.py

LARGEST_TEST_RATIO = 1.5
"""
Largest error of the test part [error of the train part]. A larger error contradicts the model, however much the strokes
scatter.
Origin: verdicts were given in spite of test errors of 2.2 and 7 times the noise (commit 543d315).
"""

LEAST_TEST_RISE = 1.10
"""
Least rise of the error on the test part that may contradict a model [error of the train part]. The strokes of some
recordings hardly scatter.
Origin: not known (1.05 before commit 851b74e).
"""

FEWEST_TEST_STROKES = 2
"""Strokes of a test part that tests whether strokes repeat [strokes]. Origin: two strokes are the fewest to repeat."""

# Range of a model: visited_range.py

RANGE_MARGIN = 0.05
"""
Distance from the range of train and validation part up to which a sample of the test part is inside [range].
Origin: not known.
"""

LEAST_OUTSIDE_SHARE = 0.01
"""Least share of the test part outside of a range that is reported [-]. Origin: not known."""

# Error of the model beyond the noise: model_error.py

SMOOTHING_TIME = 0.02
"""
Length of the moving mean that removes most of the sensor's noise from a residual [s].
Origin: chosen; a longer mean hides short errors, as at reversals of the piston.
"""

STEP_SETTLING_TIME = 0.3
"""
Time after a step of a set-point that does not count [s]. Along a path set-points have no steps.
Origin: chosen; a pressure settles in about ten times the paper's time constants of 5 to 50 ms.
"""

LEAST_SHARE_BETWEEN_STEPS = 0.5
"""
Least share of the judged samples for which the samples after steps are left out [-].
Origin: chosen; a set-point that changes all the time leaves too few samples.
"""

# Dependence of the residual: residual_dependence.py

DEPENDENCE_BINS = 24
"""Bins of equally many samples for the mean of the residual over a signal [1]. Origin: not known."""

LEAST_DEPENDENCE = 0.02
"""Least share of the residual's power of a dependence that is reported [-]. Origin: not known."""

MOST_DEPENDENCES = 3
"""Dependences that the summary names [1]. Origin: not known."""

MOST_PLOTTED_SAMPLES = 2000
"""
Most samples of a plot of the residual over a signal [1].
Origin: more dots hide each other in a plot 300 pixels wide.
"""

LEAST_MOVING_SPEED = 0.05
"""Least speed of a piston that has a direction of motion [standard deviations of the speed]. Origin: not known."""

LEAST_POWER = 1e-300
"""Least power of a residual that is divided by [signal's unit squared]. Origin: a guard against division by zero."""

# Confirmation of a curve: loop.py

LARGEST_CURVE_ERROR = 0.92
"""
Largest error with a curve on the validation or test part [error without the curve]. A smaller drop may be an error of
the core.
Origin: 75 of 75 healthy devices of full physics still ended with nothing missing (commit 46643e6; 0.88 before).
"""

LARGEST_CURVE_ERROR_WITH_EFFECTS = 0.8
"""
Largest error with a curve together with effects on the validation or test part [error without the curve].
Origin: a measured run got a curve for a tenth of the error, and no rerun of it did (commit bd85933).
"""

LARGEST_FADING_CURVE_ERROR = 0.5
"""
Largest error on the test part with a curve that is reported although the test part contradicts it [error without the
curve]. A pressure that crept for seconds stayed without an explanation before (commit 1c342e9).
Origin: not known.
"""

# Estimated curve: characteristic.py

CURVE_POINTS = 41
"""Points of a reported curve [1]. Origin: not known."""

FEWEST_VISITS = 20
"""
Fewest samples near a visited point of a curve [samples].
Origin: a piston that jumps past a point has two samples in each stroke there (commit 32f0c9f; 5 before).
"""

BAND_HALF_WIDTH = 1.96
"""Half of a curve's band [standard errors]. Origin: 95 % of a normal distribution at each point."""

CORNER_ERROR = 1.0 / 24.0
"""
Error of the straight lines between knots [bend of the curve].
Origin: the error of a fitted straight line midway, in an even curve (commit 25fe2b7).
"""

MODEL_ERROR = 0.004
"""
Part of a curve's band for errors of the model [range of the curve].
Origin: at 0.0025 bands of two unseen seeds covered 89.9 % of 1,491 points instead of 95 % (commit 433f209).
"""

LARGEST_FORMULA_SQUARES = 1.05
"""
Largest sum of squares of a simulation with a formula in the place of its curve [sum of squares with the curve].
Origin: not known.
"""

FORMULA_SEARCH = (1e-4, 10)
"""
End of a fit of the gains with a formula: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

# Formulas of a curve: formulas.py

LEAST_SHARE_IN_BAND = 0.94
"""
Least share of a curve's points at which a formula is within the 95 % band [-]. The simulation with the formula also has
to err as little as with the curve.
Origin: a true formula missed the band at one of 32 points, and at the last two of 38.
"""

MOST_FORMULAS = 3
"""Most formulas that are reported for a curve [1]. Origin: not known."""

REFINED_STARTS = 2
"""
Starts of a formula's search that are refined, the ones with the smallest errors [1].
Origin: not known (all starts before commit 004ac49).
"""

MOST_FORMULA_EVALUATIONS = 60
"""Evaluations of a formula from each start [1]. Origin: not known."""

FEWEST_CURVE_POINTS = 5
"""Fewest points of a curve that a formula is fitted to [1]. Origin: not known."""

PLACE_BOUNDS = (-1.2, 1.2)
"""
Places in a formula that are searched [half of the visited range, from its middle]. A place is hardly outside the range.
Origin: not known.
"""

LENGTH_BOUNDS = (0.05, 4.0)
"""Lengths in a formula that are searched [half of the visited range]. Origin: not known."""

LEAST_BAND = 1e-12
"""Least width of a curve's band that is divided by [range of the curve]. Origin: a guard against division by zero."""

LEAST_CURVE_RANGE = 1e-300
"""Least range of a curve that `LEAST_BAND` refers to [curve's unit]. Origin: a guard against division by zero."""

# Pressure behind a shut valve: decay.py

FEWEST_DECAY_SAMPLES = 50
"""Fewest samples of a decay [samples]. Origin: not known."""

LEAST_DECAY_NOISE = 1e-3
"""
Least noise of a pressure [Pa]. A pressure that was computed has no noise.
Origin: a guard against division by zero (commit 4480209).
"""

LEAST_GAUGE_PRESSURE = 1e3
"""Least median of the gauge pressure in a decay [Pa]. Origin: not known."""

LARGEST_LAW_ERROR = 2.0
"""
Largest error on the second half of a decay for a leak model that is not excluded [standard deviations of the noise].
Origin: not known.
"""

LARGEST_LAW_ERROR_RATIO = 1.5
"""
Largest error on the second half of a decay for a leak model that is not excluded [error of the best leak model, or the
noise].
Origin: not known.
"""

LEAST_LAW_DISTANCE = 25.0
"""
Least distance between the pressures of two leak models that a decay distinguishes [standard deviations of the noise].
Settling compensates for most of a smaller distance.
Origin: not known.
"""

LARGEST_SETTLING_RATIO = 0.9
"""
Largest error of a fit with settling that takes the place of a fit without [error without settling].
Origin: not known.
"""

LARGEST_SETTLING = 0.2
"""
Largest settling, either way [highest gauge pressure]. Larger settling would compensate for a leak.
Origin: not known.
"""

LEAST_TIME_CONSTANT = 3.0
"""Least time constant of settling [sampling periods]. Origin: not known."""

SETTLING_STARTS = 4
"""Time constants of settling that a fit starts from [1]. Origin: not known."""

LARGEST_START_PRESSURE = 1.2
"""Largest gauge pressure at the start that is searched and tabulated [highest gauge pressure]. Origin: not known."""

LEAST_TABULATED_PRESSURE = 1e-4
"""Least gauge pressure down to which a fall is tabulated [highest gauge pressure]. Origin: not known."""

TABULATED_PRESSURES = 4000
"""Pressures at which a fall is tabulated [1]. Origin: not known."""

DECAY_TOLERANCE = 1e-12
"""Relative change of sum, unknowns and slope at which a decay's fit ends [-]. Origin: not known."""
