"""What the variance against a contact comes from.

Angles, zeros and load of a calibration are correlated, and their errors stand against each other:
their variances do not add up. A source's share is its Shapley value with the variance that knowing
it takes away, Var E[w | sources], averaged over all orders in which they become known (Owen and
Prieur, SIAM/ASA J. Uncertainty Quantification 5, 2017): never negative, and 1 in sum.
"""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import layout
from tdfscal.records import FloatArray

#: Parameters of each source; what is not named is the rig's geometry, and counts as calibration.
GROUPS = {
    "zeros": ("zero",),
    "load": ("mass", "barycentre"),
    "gain": ("sensitivity",),
}
SOURCES = ("calibration", *GROUPS, "noise")


def calibration_variances(given: Calibrated, jacobian: FloatArray) -> dict[str, FloatArray]:
    """Parts (6,) of the wrench's mean variance over places, by source of the calibration.

    jacobian : (B, 6, P).
    """
    place, P = layout(given.rig.n), len(given.covariance)
    member = np.zeros(P, dtype=np.intp)
    for g, groups in enumerate(GROUPS.values(), 1):
        for name in groups:
            member[place[name]] = g
    scale = np.sqrt(np.diagonal(given.covariance))
    used = scale > 0
    C = given.covariance[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    J = jacobian[:, :, used] * scale[used]
    mean = np.einsum("bcp,bcq->cpq", J, J) / len(J)  # (6, p, p)
    member, count = member[used], 1 + len(GROUPS)
    explained = {}
    for size in range(count + 1):
        for subset in combinations(range(count), size):
            known = np.isin(member, subset)
            gain = np.zeros((len(C), len(C)))
            if known.any():
                cross = C[:, known]
                gain = cross @ np.linalg.pinv(C[np.ix_(known, known)], 1e-9, True) @ cross.T
            explained[subset] = np.einsum("cpq,pq->c", mean, gain)
    parts = {}
    for g, name in enumerate(("calibration", *GROUPS)):
        rest = [other for other in range(count) if other != g]
        parts[name] = sum(
            (
                (explained[tuple(sorted((*subset, g)))] - explained[subset])
                / (count * comb(count - 1, size))
                for size in range(count)
                for subset in combinations(rest, size)
            ),
            np.zeros(6),
        )
    return parts
