"""What a laser-tracker calibration takes as exact, and by how much it would turn each sensor."""

from __future__ import annotations

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, TrackerSession
from tdfscal.selfcal.exact_quantities import ExactQuantity

#: A workshop's drawing, m, and a sensor's body against its axes, rad.
_DRAWING, _MISALIGNMENT = 1e-4, 1e-3


def exact_quantities(
    supports: tuple[str, ...], rotation: FloatArray, session: TrackerSession, misalignment: float
) -> tuple[ExactQuantity, ...]:
    """Drawing and misalignment of body and axes, where nothing is stated of them.

    rotation : (n, 3, 3), of the sensors.
    """
    n, found = len(supports), []
    if misalignment == 0:
        turns = _MISALIGNMENT * np.eye(3 * n)
        found.append(ExactQuantity("body against axes", _MISALIGNMENT, "rad", turns))
    if session.drawing == 0 and session.nominal.std is None:
        moves = np.zeros((3 * n, 3 * n))
        for i, name in enumerate(supports):
            rows = slice(3 * i, 3 * i + 3)
            moves[rows, rows] = rotation[i] @ _by_drawing(session, name)
        found.append(ExactQuantity("target drawing", _DRAWING, "m", moves))
    return tuple(found)


def _by_drawing(session: TrackerSession, name: str) -> FloatArray:
    """Root (3, 3) of the covariance of a best fit's turn by its points' errors, sensor frame.

    Each coordinate is off by itself: (Σ [r]×ᵀ [r]×)⁻¹ of the points about their middle.
    """
    group = np.array([g == name for g in session.nominal.group])
    arm = session.nominal.xyz[group]
    lever = so3.hat(arm - arm.mean(axis=0))
    values, vectors = np.linalg.eigh(np.einsum("pca,pcb->ab", lever, lever))
    return np.asarray(_DRAWING * vectors / np.sqrt(values))
