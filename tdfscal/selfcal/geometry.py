"""The distances between hinges over the postures, held against the rig file."""

from __future__ import annotations

import numpy as np

from tdfscal.checks.geometry import examine
from tdfscal.checks.hinge_distances import Cause
from tdfscal.estimation.closure import framed_positions, misplaced
from tdfscal.estimation.suspicion import Suspicion
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.model.parameters import layout
from tdfscal.model.statics import forces
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit


def misplaced_hinges(of: Estimate[Fit]) -> tuple[Suspicion, ...]:
    """Name what contradicts the stated distances between hinges, with what it does to angles."""
    fit = of.fit
    used = np.flatnonzero(fit.weight > 0)
    seen = fit.at.seen.subset(used)
    variance = np.trace(seen.position_cov, axis1=2, axis2=3).mean(axis=1) / 3
    found = examine(fit.rig, seen.position, variance, forces(fit.state, seen.force), frames=True)

    def framed(cause: Cause) -> FloatArray:
        logged = np.zeros_like(fit.postures.position)
        logged[used] = framed_positions(cause, seen.position)
        by_place = fit.slopes[:, :, layout(fit.rig.n, fit.state.motions)["datum"]]
        white = by_place @ logged.reshape(len(logged), -1, 1)
        return np.asarray(white.ravel())

    return misplaced(of, found, framed)
