"""A log that is read wrongly is no rig that changed: names, signs, units of its readings.

What explains forces that fit nowhere is searched as a calibration does it (`selfcal.misreadings`),
by a rig of which the calibration is known; it is held against what may have changed by likelihood.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.model.calibrated import Calibrated, informed, loosened
from tdfscal.model.parameters import starting_state
from tdfscal.model.postures import Postures
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import fit
from tdfscal.selfcal.misreadings import MOST_POSTURES, misread, misreading
from tdfscal.significance import CAUSES_APART
from tdfscal.validation.verdict import Judged


def refuse_misread(
    given: Calibrated,
    rig: Rig,
    seen: Postures,
    judge: Callable[[Postures, IntArray], Judged] | None = None,
    number: IntArray | None = None,
    time: FloatArray | None = None,
) -> None:
    """Raise DataError where one mistake in the readings explains them, likelier than any change.

    given : the calibration, with the load of this log. seen : K postures, or moments of a motion.
    judge : of postures, and which of K they are, by the calibration; without it the search itself
    is the judge. number, time : (K,), by which the postures go, and s, when each was held, where
    they are rests.
    """
    some = np.unique(np.linspace(0, len(seen) - 1, MOST_POSTURES).round().astype(np.int64))
    seen = seen.subset(some)
    if number is not None and time is not None:
        number, time = number[some], time[some]
    known = loosened(informed(rig, given))
    present = fit(known, seen, starting_state(known, seen.motions))
    found = misreading(known, seen, present, number, time)
    if found is None:
        return
    if judge is not None:
        now = judge(seen, some)
        if found.jump is not None:  # a cause too, which stands beside a slip there
            best = now.causes.best[0]
            if (best.kind, best.support) != ("zero jumped", found.support):
                return
            raise misread(known, found, present, number, time)
        without = judge(found.fit.postures, some)
        # What has a number is no likelier by little, nor beside a second cause.
        apart = 0.0 if found.exact else CAUSES_APART
        if without.merit <= (now.merit[0], now.merit[1] + apart) or not (
            found.exact or without.holds
        ):
            return
    raise misread(known, found, present, number, time)
