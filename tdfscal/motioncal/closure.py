"""What a wrong geometry, known by the distances between hinges alone, does to angles in motion."""

from __future__ import annotations

import numpy as np

from tdfscal.checks.geometry import examine
from tdfscal.checks.hinge_distances import Cause
from tdfscal.model.parameters import layout
from tdfscal.model.statics import Postures, forces
from tdfscal.motioncal.covariance import MovingUncertainty
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.closure import displaced_hinges, suspected
from tdfscal.selfcal.suspicion import Suspicion

#: Instants that are looked at. The positioners' errors are alike at places near each other, so
#: that more of them would not know more; nor do any number of them average these errors out.
_INSTANTS = 24


def misplaced(
    fit: MovingFit, uncertainty: MovingUncertainty, seen: Postures
) -> tuple[Suspicion, ...]:
    """Name what contradicts the stated distances between hinges, with what it does to angles.

    seen : instants of the motion, forces that nobody measures as the balance demands them.
    """
    rig, still = fit.rig, fit.state.still
    some = np.unique(np.linspace(0, len(seen) - 1, _INSTANTS).astype(np.int64))
    position, force = seen.position[some], forces(still, seen.force[some])
    own = rig.declared.positioner
    variance = np.full(len(some), own**2 + fit.slow.quantum**2 / 12)
    found = examine(rig, position, variance, force, common=own)
    if not found.causes:
        return ()
    places = layout(rig.n, still.motions)
    parts, p = spectrum(fit.whitened()[1]), int(fit.active.sum())

    def move(cause: Cause) -> FloatArray:
        """How far the free parameters give way to it."""
        step = np.zeros(fit.slope_at(fit.state).shape[1])
        if (hinge := displaced_hinges(rig, cause)) is not None:
            step[places["hinge"]] = hinge.ravel()
        elif cause.kind == "compliance":
            step[places["compliance"]] = cause.amount
        else:
            step[places["datum"]].reshape(rig.n, 3)[cause.support] = cause.amount
        design = fit.rows.design @ (fit.slope_at(fit.state) @ step)[:, None]
        white = fit.rows.weighted(design, fit.noise.variance(fit.rows.bins))
        return np.asarray(parts.root[:p] @ (parts.left[: len(white)].T @ white)[:, 0])

    return suspected(rig, uncertainty.turns, found, move)
