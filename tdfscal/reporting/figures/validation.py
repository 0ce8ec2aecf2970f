"""The residual contact wrench of a validation, before and after."""

from __future__ import annotations

import numpy as np

from tdfscal.reporting.figures.residuals import paint
from tdfscal.reporting.figures.style import Drawing
from tdfscal.validation.residual_wrench import Validation


def draw(v: Validation) -> Drawing:
    """Length of the residual force and moment, posture by posture."""
    before, after = (np.linalg.norm(w.reshape(-1, 2, 3), axis=2) for w in (v.nominal, v.calibrated))
    worst = int(after[:, 0].argmax())
    return Drawing(
        "validation",
        "Residual contact wrench at each posture",
        "Nothing should touch the terminal at these postures, so that no force should be left; "
        f"the largest is {after[worst, 0]:.2g} N, at posture {v.used[worst] + 1}.",
        lambda: paint(v.used + 1, before, after, "after: with this calibration"),
    )
