"""The quality gate: may this result steer a machine?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.acceptance.conformity import Conformity
from tdfscal.acceptance.turns import turn_names, turn_std
from tdfscal.records import BoolArray, Rig, Rotations
from tdfscal.significance import MOST_REJECTED


def judge(
    rig: Rig,
    found: Rotations,
    birge: float,
    *,
    determined: BoolArray | None = None,
    used: int = 0,
    rejected: int = 0,
    suspicions: Sequence[str] = (),
    conformity: Conformity | None = None,
) -> tuple[str, ...]:
    """Reasons to reject rotations by the uncertainty of their turns about the BCS's axes.

    None: accepted. determined : (n,), sensors that are judged, by default all. used, rejected :
    numbers of postures. suspicions : harmful ones, in
    words. conformity : of the contact wrench, where the rig file states a limit.
    """
    limits, reasons = rig.acceptance, []
    std, names = turn_std(found.covariance), turn_names(found.rotation)
    judged = np.ones(rig.n, dtype=np.bool_) if determined is None else determined
    for i, j in np.argwhere(~(std <= limits.angle_std) & judged[:, None]):
        reasons.append(
            f"{names[i][j]} of {rig.supports[i]} has a standard uncertainty of "
            f"{1e3 * std[i, j]:.2g} mrad, above the limit of {1e3 * limits.angle_std:.2g} mrad"
        )
    if birge > limits.birge_max:
        reasons.append(
            f"the residuals are {birge:.2g} times what the stated uncertainties explain, above "
            f"the limit of {limits.birge_max:.2g}"
        )
    if rejected > MOST_REJECTED * (used + rejected):
        reasons.append(
            f"{rejected} of {used + rejected} postures had to be rejected, above the limit of "
            f"{MOST_REJECTED:.0%}"
        )
    reasons += suspicions
    if conformity is not None:
        reasons += conformity.reasons
    return tuple(reasons)
