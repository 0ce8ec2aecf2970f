"""Postures in contact that hide each other: the fit by the half of them that agree best.

Contacts that push alike at a third of the postures pull the fit to themselves, zeros and angles
with it: then every posture is off, and none stands out. Least trimmed squares do not ask who stands
out, but which half agrees: fits from a few postures drawn at random, each with the half that it
explains best, again and again (concentration); χ² of that half never rises.

References
----------
Rousseeuw, Van Driessen: Computing LTS regression for large data sets. Data Min. Knowl. Discov. 12
(2006) 29–45.
"""

from __future__ import annotations

import numpy as np

from tdfscal.model.statics import Postures
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.selfcal.estimator import ROWS, Fit, fit
from tdfscal.selfcal.outliers import RobustFit, settled

#: Random starts, of so many postures each: with a third of them touched, four are clean in one of
#: six. Steps of each, linear; the best that are followed to their end, and their steps.
_STARTS, _DRAWN, _STEPS = 100, 4, 5
_FOLLOWED, _FITS = 3, 3


def hidden_contact(rig: Rig, postures: Postures, whole: Fit) -> RobustFit | None:
    """The fit by the postures that agree, less than half of them left out; None where none are.

    whole : the fit by all of them, every weight 1.
    """
    K = len(postures)
    half = K // 2 + 1
    if half < 2 * _DRAWN:
        return None
    best: Fit | None = None
    for used in _agreeing(whole, half)[:_FOLLOWED]:
        found = fit(rig, postures, whole.state, used.astype(np.float64))
        for _ in range(_FITS):
            weight = np.zeros(K)
            weight[np.argsort(found.distance)[:half]] = 1.0
            found = fit(rig, postures, found.state, weight)
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    result = settled(rig, postures, best)
    out = int(np.sum(result.weight == 0))
    return RobustFit.of(result) if 0 < out <= K - half else None


def worth(of: Fit, whole: Fit) -> float:
    """Fall of −2 ln L from the fit by all postures to one without some, by Schwarz.

    Each that is left out has a wrench of its own: six unknowns.
    """

    def misfit(fit: Fit) -> float:
        return fit.cost + float(np.sum(np.linalg.slogdet(fit.at.cov)[1]))

    unknowns = ROWS * int(np.sum(of.weight == 0))
    return misfit(whole) - misfit(of) - unknowns * float(np.log(max(whole.rows, 2)))


def _agreeing(whole: Fit, half: int) -> list[BoolArray]:
    """Sets of so many postures (K,) that agree, as the linearised fit has it; the best first."""
    K, rng = len(whole.weight), np.random.default_rng(0)
    white, J = whole.whitened()
    r, prior_r = white[: ROWS * K].reshape(K, ROWS), white[ROWS * K :]
    prior_J, J = J[ROWS * K :], J[: ROWS * K].reshape(K, ROWS, -1)
    own, pull = np.swapaxes(J, 1, 2) @ J, np.einsum("kap,ka->kp", J, r)

    def distances(used: BoolArray) -> FloatArray:
        normal = own[used].sum(axis=0) + prior_J.T @ prior_J
        step = np.linalg.pinv(normal, hermitian=True) @ (
            pull[used].sum(axis=0) + prior_J.T @ prior_r
        )
        return np.asarray(np.sum((r - J @ step) ** 2, axis=1))

    found: dict[bytes, tuple[float, BoolArray]] = {}
    for _ in range(_STARTS):
        used = np.zeros(K, dtype=np.bool_)
        used[rng.choice(K, _DRAWN, replace=False)] = True
        for _ in range(_STEPS):
            off = distances(used)
            used = np.zeros(K, dtype=np.bool_)
            used[np.argsort(off)[:half]] = True
        found[used.tobytes()] = float(distances(used)[used].sum()), used
    return [used for _, used in sorted(found.values(), key=lambda each: each[0])]
