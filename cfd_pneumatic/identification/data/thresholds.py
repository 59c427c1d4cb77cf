# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# What a recording must hold

FEWEST_SAMPLES = 20
"""
Fewest samples of a signal that can be fitted [samples]. A fit has four gains and a set-point, and needs samples to
judge them.
Origin: the number of unknowns (commit f1faaa5).
"""

LONGEST_PERIOD = 100.0
"""
Longest median time between displacement samples [s]. A pressure settles in seconds, long before the next sample.
Origin: the time in which a pressure settles (commit 9b2e0fc).
"""

LARGEST_DISPLACEMENT = 1e3
"""Largest displacement, either way [m]. No device moves as far: the unit or the column is wrong. Origin: not known."""

LARGEST_TOLERANCE = 1e9
"""
Largest tolerance that a user may give [Pa, N or %]. Errors could never exceed a larger tolerance.
Origin: not known.
"""

LONGEST_SHOWN_TEXT = 40
"""Characters of a wrong tolerance that a message quotes [characters]. Origin: not known."""

# Train, validation and test part

SMALLEST_FRACTION = 0.01
"""Smallest share of a recording that a part may be [-]. A smaller part holds no motion. Origin: not known."""

FRACTIONS_TOLERANCE = 1e-6
"""Largest difference between 1 and the sum of the three shares [-]. Origin: not known."""

FEWEST_STROKES = 5
"""
Strokes of a recording that is cut into three parts [strokes]. With fewer strokes a part has motion unlike the others.
Origin: not known.
"""

LEAST_MOTION = 8.0
"""
Displacement that counts as motion [standard deviations of the displacement's noise]. Noise alone spans less in an hour.
Origin: the comment of commit e110c1a, without a measurement.
"""

LEAST_STROKE = 0.02
"""Displacement that counts as motion [share of the range of the displacement]. Origin: not known."""

REST_SAMPLES = 10
"""First samples that show whether a recording begins at rest [samples]. Origin: not known."""

LARGEST_MOTION_AT_REST = 2e-3
"""
Largest range of the first samples of a piston at rest [share of the range of the displacement].
Origin: not known.
"""

# Clock of the stamps

FEWEST_STAMPS = 100
"""
Stamps from which a regular clock is estimated [samples]. Steps of fewer irregular stamps anticorrelate by chance.
Origin: not known.
"""

STAMPS_TOGETHER = 65_536
"""
Stamps whose clock is estimated together [samples]. The limit keeps memory small in long recordings.
Origin: the number of samples that are read together (docs/design.md, commit c30da50).
"""

CLOCK_WINDOW = 101
"""Window of the moving average that follows the drift of the clock [samples]. Origin: not known."""

LARGEST_JITTER = 0.2
"""Largest standard deviation of stamps about a regular clock [sampling periods]. Origin: not known."""

STAMP_RESOLUTION = 1e-9
"""
Least jitter that is corrected [s]. Smaller jitter is rounding.
Origin: the resolution of ROS's stamps, 1 ns (commit 7f1feb9).
"""

LARGEST_STEP_CORRELATION = -0.3
"""
Largest correlation of adjacent steps that jitter explains [-]. Irregular sampling correlates adjacent steps more.
Origin: between -0.5, of jitter about a clock, and 0, of independent steps (commit bf95838).
"""

# Smoothed displacement

BANDWIDTH_DECADES = (-4.0, 3.0)
"""Bandwidths of the smoother that are searched [decades of the mean sampling rate]. Origin: not known."""

COARSE_BANDWIDTHS = 8
"""Bandwidths that are tried before the search [1]. The search finds the nearest optimum only. Origin: not known."""

BANDWIDTH_TOLERANCE = 0.005
"""Width of the bracket at which the search for the bandwidth ends [decades]. Origin: not known."""

LARGEST_DIGIT_ERROR = 0.05
"""
Largest distance of a rounded reading from a multiple of the sensor's step [steps]. Recorded values have few digits.
Origin: not known.
"""

LEAST_SUDDEN_DRIVE = 6.0
"""
Least drive of a sudden step [standard deviations of the usual drive]. A stray reading deviates by at least as many
standard deviations of the noise.
Origin: not known.
"""

USUAL_STEPS = 0.8
"""Share of the steps, the least driven ones, that determines the usual drive [-]. Origin: not known."""

USUAL_STEPS_POWER = 0.44
"""
Mean square of this share, `USUAL_STEPS`, of a standard normal distribution [-].
Origin: follows from `USUAL_STEPS`.
"""

LEAST_STRAY = 4.0
"""
Least distance of a stray reading from the line through adjacent readings [distances of these from the line].
Origin: above 3, the ratio at a sharp corner of the motion (commit bf95838).
"""

LARGEST_BOOST = 1e18
"""Largest factor on the density of the drive in a sudden step [-]. Origin: not known."""

MOST_BOOST_ROUNDS = 5
"""
Rounds that search for sudden steps [1]. Each round smooths the other steps more, so that further sudden steps show.
Origin: not known.
"""

LEAST_VARIANCE = 1e-300
"""
Least noise variance whose logarithm is taken [squares of the unit that the smoother uses].
Origin: a guard against the logarithm of zero.
"""

LONGEST_SMOOTHED_WHOLE = 200_000
"""
Longest displacement that is smoothed without windows [samples]. The limit keeps memory small in long recordings.
Origin: not known.
"""

SMOOTHING_WINDOW = 65_536
"""
Samples that are smoothed together in long recordings [samples].
Origin: four hours at 1 kHz have to fit into the memory of one hour (commit b7b776a; 131,072 before).
"""

SMOOTHING_MARGIN = 4_096
"""
Samples on either side of a smoothing window [samples]. A smoother forgets within the margin.
Origin: the comment of commit 7f1feb9, without a measurement.
"""

TRAVEL_STRIDE = 64
"""
Stride between samples whose distances add up to the travel [samples]. The travel exceeds the noise over this stride.
Origin: not known.
"""

# Motion between the samples

GRID_PIECE = 65_536
"""
Samples whose grid is made together [samples]. Splines need several times the memory of their samples.
Origin: the number of samples that are read together (docs/design.md, commit c30da50).
"""

MOST_LINES_PER_STEP = 8
"""Straight lines that follow the displacement from sample to sample [1]. Origin: not known."""

LARGEST_BEND_OF_NOISE = 0.1
"""
Largest distance between a straight line and the displacement [standard deviations of the displacement's noise].
Origin: lines that were off by half the noise moved k_v by 0.4 standard errors; at this limit the means of all kinds of
recordings are within 0.2 standard errors (commit db06866).
"""

LARGEST_BEND_OF_STROKE = 3e-5
"""
Largest distance between a straight line and the displacement [share of the range of the displacement]. The larger of
both limits applies.
Origin: not known (3e-4 before commit db06866).
"""

MOST_PARABOLA_LINES = 4
"""
Straight lines from sample to sample that a parabola may replace [1]. With more lines the piston moves too suddenly.
Origin: not known.
"""

LONGEST_PARABOLIC = 1_000_000
"""
Longest grid of which parabolas are kept [grid steps].
Origin: at four hours parabolas would take a gigabyte of memory (commit 3322fd3).
"""

# Reversals that a seal follows

LEAST_REVERSAL = 3.0
"""Least size of a reversal [standard deviations of the smoothed displacement's noise]. Origin: not known."""

# Cuts of an experiment

INPUT_MARGIN = 0.5
"""
Time for which inputs go on after the last sample [s]. A model may read the inputs later by this time.
Origin: the bound of `transport_delay` in commit bf95838; today the upper bound of `displacement_delay`.
"""

START_SAMPLES = 3
"""Samples whose median is the start of an experiment [samples]. Origin: not known."""

BLOCK_SAMPLES = 4096
"""
Samples that are simulated together [samples]. The block stays in a processor's cache.
Origin: the size of the cache (docs/design.md, commit 1f99ac2).
"""
