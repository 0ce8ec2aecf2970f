"""The quality gate: may this result steer a machine?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdfscal.acceptance.conformity import Conformity
from tdfscal.acceptance.turns import turn_names, turn_std
from tdfscal.findings import Finding, Value
from tdfscal.records import BoolArray, Rig, Rotations
from tdfscal.significance import MOST_REJECTED


def judge(
    rig: Rig,
    rotations: Rotations,
    birge: float,
    *,
    determined: BoolArray | None = None,
    used: int = 0,
    rejected: int = 0,
    suspicions: Sequence[Finding] = (),
    conformity: Conformity | None = None,
) -> tuple[Finding, ...]:
    """Reasons to reject rotations by the uncertainty of their turns about the BCS's axes.

    None that rejects: accepted. determined : (n,), sensors that are judged, by default all.
    used, rejected : numbers of postures. suspicions : harmful ones. conformity : of the contact
    wrench, where the rig file states a limit.
    """
    limits, found = rig.acceptance, list[Finding]()
    std, names = turn_std(rotations.covariance), turn_names(rotations.rotation)
    judged = np.ones(rig.n, dtype=np.bool_) if determined is None else determined
    for i, j in np.argwhere(~(std <= limits.angle_std) & judged[:, None]):
        values: dict[str, Value] = {"angle": names[i][j], "limit": limits.angle_std}
        found.append(
            Finding("angle-uncertain", (rig.supports[i],), float(std[i, j]), "rad", values=values)
        )
    if birge > limits.birge_max:
        values = {"limit": limits.birge_max}
        found.append(Finding("residuals-large", size=birge, values=values))
    if rejected > MOST_REJECTED * (used + rejected):
        values = {"postures": used + rejected, "limit": MOST_REJECTED}
        found.append(Finding("postures-rejected", size=rejected, values=values))
    found += suspicions
    reasons = tuple(replace(finding, rejects=True) for finding in found)
    return reasons if conformity is None else (*reasons, *conformity.findings)
