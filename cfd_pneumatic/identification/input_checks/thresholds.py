# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

LEAST_DIVISOR = 1e-300
"""Least number that is divided by [its unit]. Origin: a guard against division by zero."""

# Chamber, piston and area: results.py

USUAL_CHAMBERS = (1e-2, 0.1)
"""Chamber lengths of most devices [m]. Origin: not known."""

SMALL_CHAMBER = 1e-2
"""
Length below which a chamber is suspected if the stroke is small, too [m]. Two wrong units, inches as millimetres and
absolute psi as kPa, made a plausible chamber (commit 0573ebb).
Origin: not known.
"""

SMALL_STROKE = 2.5e-4
"""Stroke below which a small chamber is suspected [m]. Origin: not known."""

LEAST_STROKE_SHARE = 0.05
"""
Least stroke in a chamber that is longer than usual [length of the chamber].
Origin: the strokes of measured runs are a quarter of a long chamber (commit 79c7c78).
"""

BORES = (3e-3, 0.2)
"""Bores of pistons [m]. Origin: not known."""

LARGEST_AREA_RATIO = 1.5
"""
Largest ratio of the area that force and pressures determine to the area that the user gave, or of the reverse [-].
Origin: not known.
"""

ATMOSPHERE_TOLERANCE = 0.15
"""
Largest difference between ambient pressure and an offset of a pressure, or of the force over the area, that counts as
equal [ambient pressure].
Origin: not known.
"""

LEAST_FORCE_ERROR_CHANGE = 0.05
"""
Least change of the force's error that decides whether the displacement lags [error of the force].
Origin: not known.
"""

# Changed and different devices: results.py

LEAST_ERROR_RATIO = 3.0
"""
Least ratio of two errors that a changed or a different device explains [-].
Origin: not known.
"""

FEWEST_COMPARED_RECORDINGS = 3
"""
Fewest recordings that show which recording is of a different device [recordings].
Origin: two recordings do not show which of the two is odd.
"""

# Alternative readings: alternative_readings.py

LARGEST_RESIDUAL_SHARE = 0.3
"""
Largest residual of a pressure that follows the piston [spread of the pressure].
Origin: correct readings have far smaller residuals (comment of commit ad8a822, without a measurement).
"""

LARGEST_READING_RATIO = 0.5
"""
Largest residual of an alternative reading that is reported [residual of the recordings as they are].
Origin: not known.
"""

LARGEST_ALIKE_READING = 2.0
"""
Largest residual of an alternative reading that is reported together with the best alternative [residual of the best
alternative].
Origin: not known.
"""

LONGEST_READING = 20_000
"""Most samples on which alternative readings are fitted [samples]. Origin: not known."""

READING_SEARCH = (1e-3, 30)
"""
End of a fit of an alternative reading: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

STEP_ROUNDS = 3
"""
Rounds in which the residual determines the steps of a set-point that was not recorded [1].
Origin: not known.
"""

LEAST_SENSITIVITY = 1.5
"""
Least `k_x` of a pressure that follows the piston [lower bound of `k_x`]. At the bound the steps of the set-point
explain the pressure (commit 881ed93).
Origin: not known.
"""

LARGEST_ROUGH_SCALE = 1.3
"""
Largest mean square of a rough fit with a different unit or reference that is fitted to the end [mean square of the
recordings as they are].
Origin: not known.
"""

LEAST_SCALE_DROP = 0.01
"""
Least drop of the sum of squares with a different unit or reference, if both leave noise [share].
Origin: in nine cylinders the wrong reference had 1.4 to 27 % larger squares (commit 8237a43).
"""

LEAST_SCALE_EVIDENCE = 20.0
"""
Least drop of the sum of squares with a different unit or reference, if both leave noise [square of a sample].
Origin: not known.
"""

# Ripple of the displacement: sensor_ripple.py

LEAST_END_SPEED = 0.8
"""Least speed at the begin and the end of an even motion [median speed of the stroke]. Origin: not known."""

LEAST_EVEN_SPEED = 0.5
"""Least speed within an even motion [median speed of the stroke]. Origin: not known."""

EASING_TIME = 0.15
"""
Time from reaching the speed to the begin of an even motion, and time in which its ripple fades in and out [s].
Origin: not known.
"""

SHORTEST_EVEN_MOTION = 1.2
"""Shortest even motion that shows ripple [s]. Origin: not known."""

FEWEST_EVEN_SAMPLES = 50
"""Fewest samples of an even motion that shows ripple [samples]. Origin: not known."""

EVEN_MOTION_DEGREE = 5
"""Degree of the polynomial of time that describes an even motion [1]. Origin: not known."""

LARGEST_FOLLOWED_SHARE = 0.5
"""
Largest share of the ripple that the pressures may follow if the sensor makes the ripple [-].
Origin: the pressures of measured runs follow 1 to 47 % (commit 1cdbc4f).
"""

LEAST_RIPPLE_EVIDENCE = 50.0
"""
Least drop of the sum of squares without the ripple [square of a sample].
Origin: not known.
"""

# Steps of a set-point that was not recorded: setpoint_steps.py

LEAST_EXPLAINED_SHARE = 0.5
"""Least share of the residual's variance that a staircase explains [-]. Origin: not known."""

LEAST_SETPOINT_STEP = 5.0
"""Least range of the levels of a staircase [standard deviations of the noise]. Origin: not known."""

LEAST_STEEP_SHARE = 0.8
"""
Least share of the steps that lies next to the cuts [-]. Slopes and swings have less.
Origin: not known.
"""

LEVEL_PARTS = 4
"""Parts of a level, of which the part next to a cut determines the step [1]. Origin: not known."""

FEWEST_LEVEL_SAMPLES = 50
"""Fewest samples of a level [samples]. Origin: not known."""

MOST_SETPOINT_STEPS = 40
"""Most steps of a staircase [1]. Origin: not known."""

LEAST_STEP_SHARE = 0.01
"""Least share of the sum of squares that each further step explains [-]. Origin: not known."""

MOST_REPORTED_STEPS = 20
"""Most steps that a message names [1]. Origin: not known (5 before commit 2fd63b5)."""

# Samples that no working sensor gives: samples.py

LONGEST_SPIKE = 3
"""Most samples of a leap out and back [samples]. Origin: not known."""

LEAST_PRESSURE_LEAP = 0.25
"""
Least leap of a pressure [share of the absolute pressure]. The piston may cause a smaller leap.
Origin: not known.
"""

MOST_INSPECTED_SAMPLES = 100_000
"""Most samples that a statistic of a signal uses [samples]. Origin: not known."""

LEAST_MOVED_SHARE = 0.05
"""Least motion of the piston before and after a stuck pressure [share of the stroke]. Origin: not known."""

ANSWER_TIME = 0.05
"""Time within which the pressure answers the piston [s]. Origin: not known."""

LEAST_FROZEN_TIME = 0.03
"""Least time for which a stuck pressure does not change [s]. Origin: not known."""

FEWEST_FROZEN_SAMPLES = 5
"""Fewest equal samples of a stuck pressure [samples]. Origin: not known."""

LEAST_FROZEN_SHARE = 0.05
"""Least share of the samples in motion at which a stuck pressure does not change [-]. Origin: not known."""

LARGEST_EVEN_RATIO = 1.5
"""Largest ratio of a number of repeats to the median that a slow sensor explains [-]. Origin: not known."""

STROKE_TIME = 0.5
"""Time of a stroke out and back, about [s]. Origin: not known."""

LARGEST_STEP_SHARE = 0.01
"""
Largest step of a sensor in the check for stuck pressures [share of the range in a stroke].
Origin: with coarser steps a working sensor often repeats a value.
"""

LEAST_ALTERNATION = 10.0
"""
Least ratio of the distance to the last sample and to the sample before that, for two sources in turn [-].
Origin: not known.
"""

LEAST_SOURCE_DISTANCE = 0.01
"""Least distance of the values of two sources [share of the range]. Origin: not known."""

LEAST_ALTERNATING_SHARE = 0.3
"""
Least share of the samples that come from two sources in turn [-].
Origin: of noise the share is a sixteenth.
"""

FEWEST_SAMPLES_AT_LIMIT = 100
"""Fewest samples of a signal that is checked for a limit of its sensor [samples]. Origin: not known."""

LEAST_LIMIT_SHARE = 0.005
"""Least share of the samples at a limit [-]. Origin: not known."""

LARGEST_REPEATED_SHARE = 0.3
"""
Largest share of repeated samples elsewhere [-].
Origin: a coarse sensor repeats its value anywhere.
"""

LARGEST_STEPS_INTO_LIMIT = 1.5
"""
Largest step into a turn of the piston [steps of the sensor].
Origin: a coarse sensor goes into a turn by single steps.
"""

LEAST_LEAP_OUT = 2.0
"""Least leap out of a stuck value [99th percentile of the steps elsewhere]. Origin: not known."""

RARELY_REPEATED_SHARE = 0.1
"""Largest share of repeated samples of a sensor that rarely repeats a value [-]. Origin: not known."""

FEWEST_STUCK_VALUES = 2
"""
Fewest values at which a signal is stuck [1].
Origin: a force without contact rests at a single value.
"""

LONGEST_RESOLVED_INTERVAL = 5.5e-3
"""Longest interval between samples in which no piston or pressure makes a whole step [s]. Origin: not known."""

LEAST_SHIFT = 5.0
"""Least shift of a zero [99th percentile of the changes]. Origin: not known."""

LEAST_SHIFT_SHARE = 0.05
"""Least shift of a zero [share of the range]. Origin: not known."""

LEAST_SHIFT_COUNTS = 10.0
"""
Least shift of a zero [smallest changes of the sensor].
Origin: a sensor may flicker by a count.
"""

LEAST_LONE_SHIFT = 5.0
"""Least shift of a zero [largest change around the shift]. Origin: not known."""

SHIFT_TIME = 0.1
"""
Time before and after a shift in which the values stay [s].
Origin: a pulse of the pressure has decayed by then.
"""

MOST_SHIFTS = 3
"""Most shifts that a message reports [1]. Origin: not known."""

LEAST_STEPS_TO_STUCK = 4.0
"""
Least step into and out of a stuck value [steps of the sensor].
Origin: a signal settles in smaller steps.
"""

MEAN_SAMPLES = 9
"""Samples of a mean in the check for clipping [samples]. Origin: not known."""

LEAST_CLIPPED_RANGE = 60.0
"""Least range of a pressure that is checked for clipping [noise of a mean]. Origin: not known."""

LEAST_PILE_SHARE = 0.02
"""
Least share of the samples in a pile at an end of the range [-].
Origin: of clean recordings the share is 0.001.
"""

LEAST_PILE_RATIO = 2.5
"""
Least ratio of the samples in a pile to the samples next to the pile [-].
Origin: at the turns of a sine the ratio is 2.4.
"""

LARGEST_SHARE_BEYOND = 2e-3
"""Largest share of the samples beyond a pile [-]. Origin: not known."""

LEAST_SHARE_BETWEEN = 0.1
"""Least share of the samples between two piles [-]. Origin: not known."""

SETTLING_TIME = 0.5
"""Time after a step of the set-point in which clipping is not checked [s]. Origin: not known."""

LEAST_RANGE_AT_SETPOINT = 10.0
"""Least range about the set-point that is checked for clipping [noise of a mean]. Origin: not known."""

LEAST_SPEED_CHANGE = 0.25
"""
Least spread of the speed at a pile [standard deviations of all speeds].
Origin: at the turns of a pressure that follows the speed the spread is smaller.
"""

LEAST_CHANGE_RATIO = 0.5
"""Least number of changes of a noisy set-point [1 / samples of the pressure]. Origin: not known."""

LEVEL_SAMPLES = 50
"""Samples of a mean of the set-point [samples]. Origin: not known."""

LARGEST_LEVEL_CHANGE = 5.0
"""Largest change between two means of the same level [noise of a mean]. Origin: not known."""

LEAST_HELD_SHARE = 0.6
"""Least share of the means that are at the level of the mean before [-]. Origin: not known."""

# Recordings: recordings.py

STROKES = (2e-5, 0.5)
"""Strokes of the piston of usual devices [m]. Origin: not known."""

PERIODS = (4e-5, 0.5)
"""Usual sample periods [s]. Origin: not known."""

GAUGE_PRESSURES = (1.5e4, 1e6)
"""Usual gauge pressures of a cylinder [Pa]. Origin: not known."""

CHAMBER_LENGTHS = (5e-3, 0.45)
"""
Usual ratios of the absolute pressure and `k_x`: the length of a chamber of the piston's area [m].
Origin: not known.
"""

LEAST_GAUGE_PRESSURE = -5e3
"""
Least gauge pressure of a regulator [Pa].
Origin: no regulator holds a vacuum.
"""

LARGEST_SETPOINT_ERROR = 1e4
"""Largest distance of a pressure at rest from its set-point [Pa]. Origin: not known."""

LARGEST_SETPOINT_ERROR_SHARE = 0.3
"""Largest distance of a pressure at rest from its set-point [share of the gauge pressure]. Origin: not known."""

AT_SETPOINT_SHARE = 0.1
"""
Largest distance of a pressure from its set-point in another unit [share of the gauge pressure].
Origin: not known.
"""

LARGEST_DUPLICATE_DIFFERENCE = 1e-9
"""Largest relative difference of two recordings of the same data [-]. Origin: not known."""

LONGEST_BATCH_INTERVAL = 0.5
"""Longest interval between samples that is no gap [s]. Origin: not known."""

LARGEST_BATCH_SHARE = 0.3
"""
Largest interval within a batch [mean interval].
Origin: jitter and missed samples leave most intervals longer.
"""

FEWEST_INTERVALS = 100
"""Fewest intervals that are checked for batches [1]. Origin: not known."""

LARGEST_SHARED_TIMES = 0.3
"""Largest share of samples with the time of another that were logged twice by chance [-]. Origin: not known."""

MOST_GUESSES = 3
"""Most units that a message proposes [1]. Origin: not known."""

LARGEST_ROUGHNESS = 0.6
"""
Largest change from sample to sample [standard deviations].
Origin: of independent samples the ratio is 1.4.
"""
