"""Alarm levels and coverage factors of the whole package, each with its use and its reason.

An alarm level is the probability that a check speaks where nothing is wrong. Levels "per log", "per
campaign" and "per survey" are divided among the tests made there (Bonferroni), so that a long log
raises no more false alarms than a short one.
"""

from __future__ import annotations

from math import erf, sqrt
from typing import Final

import numpy as np

from tdfscal.records import FloatArray

# Coverage -----------------------------------------------------------------------------------------

#: Of every interval about an angle, in files, texts and figures: the field's custom (GUM, 6.3).
INTERVAL_COVERAGE: Final = 0.95
#: k of every expanded uncertainty (E_n, limits): ISO 17043.
COVERAGE_FACTOR: Final = 2.0
#: Coverage of k = 2 in one dimension, normal distribution: 95.45 %.
EXPANDED_COVERAGE: Final = erf(COVERAGE_FACTOR / sqrt(2.0))

# The self-calibration -----------------------------------------------------------------------------

#: That a faultless campaign, or log in motion, is questioned in any way: suspicions, outlying
#: postures, a changed rig. The shares below make up the whole of it; what the tests
#: have in common, and the shapes of their rejections, leave it nearer six in a thousand.
QUESTIONED: Final = 8e-3
#: Of it: that a faultless campaign loses a posture as an outlier.
OUTLYING_POSTURE: Final = 0.125 * QUESTIONED
#: Trials whose quantiles stand for an interval: 25 lie beyond either end of one of 95 %.
FEWEST_TRIALS: Final = 1000
#: That score tests raise any suspicion of an undeclared error.
UNDECLARED_ERROR: Final = 0.375 * QUESTIONED
#: That a sensor is said to have turned on the way, or a zero to have jumped. Divided among all
#: splits, which are so much alike that half of it comes true.
WITHIN_CAMPAIGN: Final = 0.15 * QUESTIONED
#: That a contact is said to have stayed over a run of postures, of all runs.
STAYING_CONTACT: Final = 0.05 * QUESTIONED
#: That the distances between hinges are said to contradict the rig file, as a whole or by any
#: single cause; and, where they agree, that any positioner's frame is called turned, scaled or not
#: square.
GEOMETRY_MISFIT: Final = 0.1 * QUESTIONED
FRAME_MISFIT: Final = 0.025 * QUESTIONED
#: That χ² of the residuals is reported; the Birge ratio has inflated already.
MISFIT: Final = 0.075 * QUESTIONED
#: That in a log in motion a sensor is said to have turned, a zero to have jumped, or the delay to
#: have changed.
CHANGED_RIG: Final = 0.025 * QUESTIONED
#: Share of postures or points left out above which not they are wrong, but the model (theory, 3).
MOST_REJECTED: Final = 0.10
#: How many times the positions' scatter, as stated and as the hinges' distances show it, a motion's
#: residual moments may ask for: statements are guesses within a factor of ten.
MOST_POSE_NOISE: Final = 10.0
#: That the less likely of two mountings is the true one: both are named, and neither is chosen, as
#: long as it is likelier than this. Half a turn is a crash, not an error of measurement.
AMBIGUOUS_MOUNTING: Final = 1e-6
#: Shares of `UNDECLARED_ERROR`. The direction of gravity has most: it turns every sensor alike, and
#: only internal forces betray it, so that it does harm before it is plain. Friction shows faintly
#: too. The other suspects share the rest.
UNDECLARED_GRAVITY_SHARE: Final = 0.7
UNDECLARED_FRICTION_SHARE: Final = 0.15
#: Standard uncertainties of an angle: an undeclared error that moves it farther spoils the result.
HARMFUL_SHIFT: Final = 2.0
#: One that moves neither an angle nor a zero by so many is a note: it widens none by 3 %.
HARMLESS_SHIFT: Final = 0.25
#: Where chance gives as much with less than this probability, one that moves it by so many already:
#: what is certainly undeclared passes for noise too, and widens the uncertainties themselves.
CERTAINLY_UNDECLARED: Final = 1e-6
CERTAIN_SHIFT: Final = 1.0
#: Residuals this improbably small: the stated uncertainties are too large.
OVERSTATED_NOISE: Final = 1e-4

# The self-calibration in motion -------------------------------------------------------------------

#: That a moving log without any contact has a stretch left out for one, per log. Strict: a stretch
#: too many costs data and puzzles the operator, and the contacts that spoil angles are far above.
CONTACT_IN_MOTION: Final = 1e-4

# Planning -----------------------------------------------------------------------------------------

#: Share of a sensor's capacity that a plan uses.
OF_CAPACITY: Final = 0.9

# Thresholds of a machine --------------------------------------------------------------------------

#: That a path without contact is said to hold one, of all six components of the wrench.
CONTACT_ON_PATH: Final = 1e-3

# Two calibrations, and a calibration on new data --------------------------------------------------

#: That two sound calibrations are called not metrologically compatible: half of it by the joint χ²,
#: half by the sensor that differs most.
INCOMPATIBLE: Final = 0.01
#: That a calibration which holds is rejected by `validate`; half of it for a turned sensor, a
#: quarter for the search for other causes, a quarter for the overall χ². One false call in 200 is
#: what a monthly check of a rig can bear.
VALIDATION_ALARM: Final = 0.005
VALIDATION_SEARCH: Final = 0.75 * VALIDATION_ALARM
VALIDATION_CHI2: Final = VALIDATION_ALARM - VALIDATION_SEARCH
#: Probability with which the smallest turn that a check calls detectable is detected.
DETECTION_POWER: Final = 0.95
#: A cause explains residuals when what it leaves is at least this probable, and what it takes less.
CAUSE_EXPLAINS: Final = 0.01
#: Two causes are told apart when one leaves this much less χ² (3σ), beyond its further unknowns.
CAUSES_APART: Final = 9.0
#: A mistake in a log is believed when without it the residuals' variance is below the present one's
#: by this, and not above what is stated by as much.
BETTER: Final = 9.0
#: Postures that are looked at for one, at most, evenly spread over the log.
MOST_POSTURES: Final = 60

# Several campaigns --------------------------------------------------------------------------------

#: Rate at which an unchanged rig raises an alarm of `monitor`, fails an `update` or does not fit
#: its pool, per year: two years raise none in 99 of 100. One rate for all of them, or the laxest
#: would contradict the others of months in which nothing happened.
ALARMS_PER_YEAR: Final = 0.005
#: Months between calibrations at most, however far off a limit is: what no history shows.
LONGEST_INTERVAL: Final = 24.0
#: Months between checks that are counted at least, a day, and at most.
_INTERVALS: Final = 1 / 30.4375, 12.0


def alarm_level(months: FloatArray | float, rate: float = ALARMS_PER_YEAR) -> FloatArray:
    """Level of all tests of a check together, so many months after the one before (…).

    The rate is spent evenly over time, however often the rig is checked.
    """
    return np.asarray(rate * np.clip(np.asarray(months), *_INTERVALS) / 12.0)


# The laser tracker --------------------------------------------------------------------------------

#: That a faultless survey has any point called outlying, per survey.
OUTLYING_POINT: Final = 0.01
#: A misfit less probable than this, of which no single point can be blamed, is refused.
UNUSABLE_SURVEY: Final = 1e-6
#: Points whose removal lowers χ² by less than this apart: likelihoods within a factor of 100.
POINTS_AS_LIKELY: Final = 9.2
#: That a scale other than 1, or groups apart, are reported of two point files which agree.
SCALE_DIFFERS: Final = 0.01
#: The mirrored fit must be this improbable before a set of points is taken to show its hand.
HANDEDNESS: Final = 0.01
#: F-test by which points are refused as mirrored; strict, for it ends the calibration.
MIRRORED: Final = 1e-4

# Static dwells ------------------------------------------------------------------------------------

#: That a faultless log is said to hold samples twice, per sensor. Strict: a copy is never in doubt.
REPEATED_BY_CHANCE: Final = 1e-6
#: False changes of level to expect per log.
LEVEL_CHANGES_PER_LOG: Final = 1e-3
#: False drifts per log.
DRIFT_PER_LOG: Final = 1e-3
#: False modes of ringing or creep per log and shape. Strict: a mode is cut from every stop.
RINGING_PER_LOG: Final = 1e-6
#: Fall of −2 ln L by which noise is slower than a stop: 1e-5 of white channels, for three unknowns.
SLOW_NOISE: Final = 25.9
#: False cut per test of what is left of a stop; a cut too many costs only a little time.
SETTLING_CUT: Final = 3e-3
#: False decay per stretch.
SETTLING_DECAY: Final = 1e-4
#: Probability of the forces before and after a burst at which they are one level still.
SAME_LEVEL: Final = 1e-4

# Does a log, a rig file or a point file fit what it came with? ------------------------------------
# Fixed multiples of a standard uncertainty: these checks speak of mistakes, not of chance.

#: Two stated values farther apart than this contradict each other.
CONTRADICTION: Final = 3.0
#: A turn from the nominal mounting beyond this has its targets' names swapped, as a rule.
FAR_FROM_NOMINAL: Final = 5.0
#: A wrench beyond this is there.
WRENCH_PRESENT: Final = 6.0
