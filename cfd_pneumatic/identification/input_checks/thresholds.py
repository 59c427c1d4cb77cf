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
Largest difference between an offset of the force and ambient pressure on the piston that counts as equal [ambient
pressure].
Origin: not known.
"""

LEAST_FORCE_ERROR_CHANGE = 0.05
"""
Least change of the force's error that decides whether the displacement lags [error of the force].
Origin: not known.
"""

# Changed and different devices: results.py

ERROR_PIECES = 10
"""Pieces of a recording whose errors are compared [1]. Origin: not known."""

FEWEST_PIECE_SAMPLES = 50
"""Fewest samples of such a piece [samples]. Origin: not known."""

LEAST_ERROR_RATIO = 3.0
"""
Least ratio of two errors that a changed or a different device explains [-].
Origin: not known.
"""

LEAST_CHANGED_ERROR = 2.0
"""
Least error before or after a change that is reported [standard deviations of the noise]. A smaller error does not
matter.
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
