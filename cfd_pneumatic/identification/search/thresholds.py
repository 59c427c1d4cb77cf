# SPDX-License-Identifier: Apache-2.0
"""Thresholds of this package: what each limits, its unit, and how it was chosen."""

from __future__ import annotations

# Fits of effects: candidates.py, complement.py

LONGEST_UNSCREENED = 2500
"""
Longest train part whose effects are fitted without a screening [grid steps].
Origin: not known (5000 before commit 9b5d721).
"""

MOST_FITTED_EFFECTS = 8
"""
Most effects of a long recording that are fitted after the screening [1].
Origin: not known (6 before commit 9b5d721).
"""

ROUGH_EXCERPT_STEPS = 5000
"""
Excerpt of each recording for rough fits [grid steps].
Origin: not known (8000 before commit b655e98).
"""

ROUGH_SEARCH = (1e-2, 10)
"""
End of a rough fit: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: after 5 evaluations chance decided between orifices and laminar leaks (commit b655e98).
"""

FINE_SEARCH = (1e-5, 20)
"""
End of a fit of a candidate to the train part: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

LEAST_MISLEADING_RESIDUAL = 5.0
"""
Least residual that may have misled the gains [standard deviations of the noise from sample to sample]. Fits of a first
effect then begin at further gains.
Origin: not known.
"""

REFINED_STARTS = 2
"""
Starts of an effect or a core that are fitted to the end, the ones with the best rough fits [1].
Origin: not known.
"""

LEAST_START_DROP = 0.7
"""
Least drop of the sum of squares from a further start that is fitted to the end [drop from the best start]. The order of
such starts may change after the rough fits.
Origin: not known (0.9 before commit b655e98).
"""

REFINED_EFFECTS = 4
"""
Effects that are fitted to the end [1]: at least as many of a short recording, at most as many of a long recording.
Origin: not known.
"""

LEAST_RIVAL_DROP = 0.3
"""
Least drop of the sum of squares with an effect of a long recording that is fitted to the end [drop with the best
effect]. The drop of the rough fit or the predicted drop has to reach it.
Origin: not known.
"""

LEAST_INDEPENDENT_CHANGE = 1e-3
"""
Least singular value of a direction that the starts of an effect add [largest singular value]. Smaller directions repeat
a further start.
Origin: not known.
"""

LEAST_DIVISOR = 1e-300
"""Least number that is divided by, or whose logarithm is taken [its unit]. Origin: a guard against zero."""

# Rough fits that are not continued: cores.py, stepwise.py

LARGEST_ROUGH_RIVAL = 2.0
"""
Largest mean square of a rough fit with an effect that is fitted to the end [mean square of the model that the effect
competes with].
Origin: of 249 rivals none above 1.41 came within a tenth of the model that it challenged (commit fc788d4).
"""

LARGEST_ROUGH_CORE = 1.2
"""
Largest mean square of a rough fit of the physical core that is fitted to the end [mean square of a model that leaves
noise].
Origin: rough fits of 84 recordings were within a tenth of their final sum (commit c4db4ef).
"""

LARGEST_ROUGH_EFFECT = 30.0
"""
Largest mean square of a rough fit with an effect, in the place of a curve, that is fitted to the end [mean square with
the curve].
Origin: not known (5 before commit 96d5790).
"""

# Choice of effects: stepwise.py

LEAST_CRITERION_DROP = 10.0
"""Least fall of the information criterion with an effect [criterion]. Origin: not known."""

LEAST_UNVALIDATED_CRITERION_DROP = 20.0
"""
Least fall of the information criterion with an effect, if the recordings have no validation part [criterion].
Origin: not known.
"""

LEAST_DROPS = (0.01, 0.03)
"""Least drop of the sum of squares with a first and with each further effect [share]. Origin: not known."""

LEAST_LARGE_DROP = 0.10
"""
Least drop of the squares of train or validation part, for an effect together with the physical core or with more than
noise remaining [share]. A smaller drop finds a name by chance. A search that begins with the second choice has to win
by as much.
Origin: a healthy seal was reported as a leak for a drop of 5 % (commit 20695dd).
"""

LARGEST_SMALL_RESIDUAL = 1.03
"""
Largest residual at which no further effect is searched for [standard deviations of the noise].
Origin: not known.
"""

MOST_EFFECTS = 3
"""Most effects of a model [1]. Origin: not known."""

MOST_UNVALIDATED_EFFECTS = 2
"""Most effects of a model, if the recordings have no validation part [1]. Origin: not known."""

TIE = 10.0
"""
Largest distance of two models that the recordings do not distinguish [criterion].
Origin: not known.
"""

LARGEST_ALIKE_ERROR = 1.05
"""
Largest validation error of a model that predicts as well as the compared model [error of the compared model].
Origin: not known.
"""

MOST_ALTERNATIVES = 2
"""Most alternatives that are reported for an effect [1]. Origin: not known."""

MOST_RIVALS = 4
"""Most rivals that are tried in the place of an effect [1]. Origin: not known."""

RIVAL_ROUNDS = 2
"""Rounds in which rivals are tried [1]. Origin: not known."""

LEAST_RIVAL_ADVANTAGE = 2.0
"""
Least fall of the information criterion with a rival that replaces an effect [criterion].
Origin: not known.
"""

# Choice of the core: cores.py, strategy.py

LARGEST_CORE_SQUARES = 0.95
"""
Largest sum of squares at which the physical core is preferred without regard to the criterion [sum of squares with the
linear core]. The physical core also has to predict the validation part better. Without this rule a core that erred by
21 % on the validation part lost to a model that erred by 56 % (commit 5bbece7).
Origin: not known.
"""

LARGE_RESIDUAL = 3.0
"""
Residual above which a model may be far from the right model [standard deviations of the noise]. Curves with little
predicted evidence and further starts of the physical core are then tried.
Origin: not known.
"""

# Places and knots of a curve: curve_places.py

KNOT_SPACINGS = (0.3, 0.1, 0.03)
"""
Spacings of a curve's knots at their middle that are tried [its parameter `crowd`, -]. A smaller spacing has more knots
near the middle.
Origin: not known (0.01 in addition before commit d0f4f2c).
"""

LEAST_VISITED_RANGE = 1e-9
"""
Least range of a variable that a curve may depend on [SI unit of the variable]. A piston at rest has neither positions
nor speeds.
Origin: a guard against a range of zero (commit 59e9026).
"""

OUTLIER_SHARE = 0.002
"""Share of the samples at either end of a variable's range that does not count [-]. Origin: not known."""

# Prediction of a curve before its fit: curve_screening.py

CURVE_STRETCH_STEPS = 10_000
"""
Stretches, together, on which curves are predicted and compared [grid steps].
Origin: not known (20,000 of each recording before commit d0f4f2c).
"""

HEIGHT_PENALTY = 1e-4
"""
Penalty on the squared heights of a curve [penalty on its squared bends]. The gains compensate for a constant height.
Origin: not known.
"""

LEAST_EIGENVALUE = 1e-14
"""
Least eigenvalue of a curve's normal matrix [largest eigenvalue].
Origin: smaller eigenvalues are rounding, and far below every penalty (commit 46643e6).
"""

# Fits of a curve: curve_fit.py

ROUGH_CURVE_SEARCH = (1e-3, 25)
"""
End of a fit that compares curves: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: at 1e-5 the last 15 of 20 evaluations changed a thousandth (commit 32f0c9f).
"""

FEWER_STRETCH_STEPS = 6000
"""
Stretches, together, on which curves are compared if the effort does not suffice for more [grid steps].
Origin: with 4000 the knots of the bent sensor of the tutorial left 1.07 times the noise.
"""

LARGEST_SKETCH_SHARE = 0.3
"""
Largest expected effort of the curves on all stretches [remaining effort]. Further knots and the fits to the train part
need more effort.
Origin: not known.
"""

SHORT_CURVE_SEARCH = (1e-2, 5)
"""
End of a fit that ranks the places of a curve: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

SHORT_STRETCH_STEPS = 1500
"""
Stretches, together, on which places of a curve are ranked by short fits [grid steps].
Origin: not known.
"""

MOST_FURTHER_PLACES = 3
"""Most places of a curve that follow from short fits or from the linear core [1]. Origin: not known."""

FINE_CURVE_SEARCH = (1e-5, 25)
"""
End of a fit whose curve is reported: least relative fall of the sum of squares [-] and most evaluations [1].
Origin: not known.
"""

PENALTY_FACTORS = (1e-6, 1e3)
"""
Bounds of the factor by which a first fit changes the penalty on the bends of a curve [-].
Origin: not known.
"""

# Limit of the effort: strategy.py, curve_search.py, stepwise.py

CURVE_SHARE = 0.5
"""Share of the effort for curves before effects are combined [remaining effort]. Origin: not known."""

EFFECT_SHARE = 0.7
"""Share of the effort for core and effects, before curves in addition to them [remaining effort]. Origin: not known."""

EFFORT_NEAR_NOISE = 2.0
"""
Factor on the limit of the effort if a core, alone or with a single effect, leaves a small residual, or if a curve comes
near the noise [-].
Origin: effects of devices of full physics need the physical core, which takes several times as long.
"""

EXPECTED_CORE_EVALUATIONS = 30
"""Evaluations of the train part that a fit of the physical core is expected to take [1]. Origin: not known."""

EXPECTED_CURVE_EVALUATIONS = 10
"""Evaluations that the fit of a curve is expected to take [1]. Origin: not known."""

EXPECTED_EFFECT_EVALUATIONS = 60
"""
Evaluations of the train part that a trial of every effect is expected to take, rough fits included [1].
Origin: not known.
"""

# Choice of a curve: curve_search.py

LARGEST_CURVE_REMAINDER = 0.7
"""
Largest predicted remainder with a curve that is fitted [squares above the noise].
Origin: a strong curve reduces the squares by more than predicted (commit 0585300; 0.6 before).
"""

LARGEST_CURVE_REMAINDER_WITH_EFFECTS = 0.53
"""
Largest predicted remainder with a curve that is fitted together with effects [squares above the noise]. Together with
effects a curve has to reduce the error more (`LARGEST_CURVE_ERROR_WITH_EFFECTS`).
Origin: not known.
"""

LARGEST_REMAINDER_OF_SOLE_CURVE = 0.25
"""
Largest predicted remainder with a curve that is tried before effects are combined [squares above the noise]. The
measured runs took 40 % longer before curves were limited (commit d37b06c).
Origin: not known.
"""

LEAST_CURVE_EVIDENCE = 50.0
"""
Least predicted rise of twice the log likelihood, and least fall of the criterion, with a curve [criterion].
Origin: not known.
"""

LEAST_EVIDENCE_SHARE = 0.6
"""Least predicted evidence for a curve that is fitted [evidence for the best curve]. Origin: not known."""

LEAST_FALLBACK_EVIDENCE_SHARE = 0.2
"""
Least predicted evidence for a curve that is fitted if no curve with more evidence comes near the noise [evidence for
the best curve]. The wide dead band of a valve had little evidence (commit ea2ac2c).
Origin: not known.
"""

CURVE_START_SHARES = (1.0, 0.3, 0.1, 0.03, 0.0)
"""
Shares of a predicted curve from which a fit may begin [-]. The fit begins at the first share that reduces the squares.
Origin: not known (without 0 before commit 1b2998a).
"""

MOST_FITTED_CURVES = 4
"""
Most curves that are fitted to stretches, and again to the train part [1].
Origin: not known.
"""

SHARPENED_SKETCHES = 2
"""
Curves, the best of the fits to stretches, that are fitted again with different knots [1].
Origin: the second of them leaves noise for the bent sensor of the tutorial (commit 333faa9; 1 before).
"""

SKETCHES_OF_PLACE = 2
"""
Most fits of a curve in each place, with different knots, that are fitted to the train part [1].
Origin: three similar curves of a place displaced the curves of further places (commit 0bd52a0).
"""

LARGEST_SHARPENED_SQUARES = 4.0
"""
Largest sum of squares of a curve on stretches that is fitted again with different knots [largest sum of squares that is
fitted to the train part].
Origin: not known.
"""

LARGEST_SKETCH_RESIDUAL = 1.5
"""
Largest residual of a curve on stretches that is fitted to the train part [standard deviations of the noise]. The
measured runs took 40 % longer before curves were limited (commit d37b06c).
Origin: not known.
"""

LARGEST_SKETCH_SQUARES = 2.0
"""
Largest sum of squares of a curve on stretches that is fitted to the train part [sum of squares of the best curve].
Origin: not known.
"""

LARGEST_NEAR_NOISE = 1.25
"""
Largest residual that hardly exceeds the noise [standard deviations of the noise]. A curve with a larger residual is no
answer.
Origin: not known.
"""

LARGEST_CORNER_ERROR = 0.07
"""
Residual that the corners of a large curve explain [residual without the curve]. Straight pieces cut such corners. It
adds to `LARGEST_NEAR_NOISE` by squares.
Origin: not known (0.05 before commit ab3fa9f).
"""

LEAST_WIDER_RANGE = 1.1
"""
Least range visited by a model with a curve at which the curve is fitted again over that range [range of the curve].
Origin: not known.
"""

LEAST_ERROR_DROP = 0.02
"""Least drop of the validation error with a curve [share]. Origin: not known."""

CLEARLY_SMALLER_ERROR = 0.8
"""
Largest validation error of a model that predicts clearly better, at any criterion [error of the compared model].
Origin: not known.
"""

FAR_SMALLER_ERROR = 0.4
"""
Largest validation error of a model with a curve that is the answer although the residual fails its tests [error of the
best model with an effect]. Two effects hardly reach it.
Origin: not known.
"""

LARGEST_HYPOTHESIS_ERROR = 0.6
"""
Largest error with a curve that is shown as a hypothesis [error of the model without the curve]. The limit holds for the
validation part and for all samples.
Origin: users want something to look at if the error is many times the noise.
"""

LARGEST_ERROR_FOR_NEW_CORE = 0.6
"""
Largest error with a curve and the linear core at which the physical core is fitted together with the curve [error of
the better core alone]. A large unknown curve may have misled the first fit of the core (commit c63b6f0).
Origin: not known.
"""

MOST_EFFECTS_WITH_CURVE = 3
"""Most effects that are searched for together with a curve [1]. Origin: not known."""

# Final fit: final_fit.py

FINAL_SEARCH_TOLERANCE = 0.01
"""
Fall of the sum of squares at which the final fit ends [variances of a sample].
Origin: no verdict changed on 40 measured runs and 259 recordings of the panel (commit 415c2f4).
"""

MOST_FINAL_EVALUATIONS = 60
"""Most evaluations of the final fit [1]. Origin: not known."""

LARGEST_IDLE_SQUARES = 1.01
"""
Largest sum of squares without an idle effect [sum of squares with the effect]. A fit that was stuck had kept an effect
at its null (commit 5c6f756).
Origin: not known.
"""

# Visibility of effects: visible_effects.py

STRENGTH = 5.0
"""
Strength of an effect that a recording should show [standard deviations of the noise].
Origin: not known.
"""

SHOWN = 0.57
"""
Least remainder of a visible effect after the model's parameters have compensated for it [standard deviations of the
noise].
Origin: such a remainder raises the error by 15 %.
"""

LEAST_PLAIN_REMAINDER = 10.0
"""
Least remainder of an effect, after small changes of the model's parameters, that is visible without a fit [least
remainder of a visible effect]. No fit compensates for so much.
Origin: not known.
"""

LARGEST_IMITATED_RATIO = 2.0
"""
Largest ratio of an effect to its remainder that is visible without a fit [-]. The model's parameters imitate less than
half of such an effect.
Origin: not known.
"""

VISIBILITY_EXCERPT_STEPS = 3000
"""
Excerpt of each recording that shows effects first [grid steps].
Origin: not known (8000 before commit 415c2f4).
"""

EXCERPT_MARGIN = 2.0
"""
Least remainder of an effect that is visible in the excerpt [least remainder of a visible effect]. The excerpt has more
motion than the recording.
Origin: not known.
"""

VISIBILITY_STRETCH_STEPS = 16_000
"""
Stretches, together, that show effects after the excerpt [grid steps].
Origin: no effect of 115 channels was visible in stretches and hidden in the whole (commit 004ac49).
"""

IMITATION_SEARCH = (1e-2, 10)
"""
End of a fit that imitates an effect by the model's parameters: least relative fall of the sum of squares [-] and most
evaluations [1].
Origin: not known.
"""
