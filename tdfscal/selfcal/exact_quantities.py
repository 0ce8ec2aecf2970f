"""What is taken as exact: by how much a typical error of it would turn each sensor.

A quantity that the rig file states without uncertainty has no part in the budget, and tests hardly
see its error: 1 mrad of level turns every sensor by 1 mrad and leaves no residual. The angles give
way to an error a (true less stated) along whitened columns c by J⁺ c a, J of all that is estimated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.parameters import layout
from tdfscal.model.statics import features_jacobian
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import information_root
from tdfscal.selfcal.estimator import Fit


@dataclass(frozen=True, slots=True)
class ExactQuantity:
    """A quantity taken as exact, and what an error of it does.

    error : typical, in `unit`, of each of its components. moves : (3n, c), rad, turns of all
    sensors in the BCS by that error of each component by itself.
    """

    name: str
    error: float
    unit: str
    moves: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3n, 3n), rad², of the turns by independent errors of the components."""
        return np.asarray(self.moves @ self.moves.T)


#: Group of parameters, what it is called, a typical error of a component, its unit; what careful
#: work with everyday means leaves: a machinist's level, CAD, a workshop drawing, a data sheet.
_TYPICAL = (
    ("tilt", "base level", 1e-3, "rad"),
    ("mass", "mass", 1e-3, "of it"),
    ("barycentre", "barycentre", 1e-3, "m"),
    ("hinge", "hinge drawing", 1e-4, "m"),
    ("datum", "servo datums", 1e-4, "m"),
    ("sensitivity", "gain, crosstalk", 1e-3, "relative"),
    ("zero", "zeros", 0.5, "N"),
)
#: Share of its entry in S by which crosstalk is smaller than gain (theory, section 3).
_CROSSTALK = np.sqrt(0.5)


def exact_quantities(fit: Fit) -> tuple[ExactQuantity, ...]:
    """Each quantity of a self-calibration that has no uncertainty of its own."""
    n, parts = fit.rig.n, information_root(fit)
    root = np.sqrt(fit.weight)[:, None, None] * fit.whitener
    white = root @ (fit.at.design @ features_jacobian(fit.state, fit.at, fit.rig.gravity))
    columns = white.reshape(-1, white.shape[2])
    left = parts.left[: len(columns)]
    angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * n)
    place = layout(n, fit.state.motions)
    found = []
    for group, name, error, unit in _TYPICAL:
        index = np.arange(place[group].start, place[group].stop)
        size = np.full(len(index), error * (float(fit.state.mass) if group == "mass" else 1.0))
        if group == "sensitivity":
            size[np.arange(len(index)) % 6 >= 3] *= _CROSSTALK
        exact = ~fit.active[index]
        if not exact.any():
            continue
        moved = parts.root @ (left.T @ (columns[:, index[exact]] * size[exact]))
        found.append(ExactQuantity(name, error, unit, moved[angles]))
    return tuple(found)
