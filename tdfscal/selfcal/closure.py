"""What a wrong geometry, known by the distances between hinges alone, does to the angles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.checks.geometry import Geometry, examine
from tdfscal.checks.hinge_distances import FRAMES, Cause
from tdfscal.model.parameters import layout
from tdfscal.model.statics import forces
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.covariance import Estimate, Uncertainty
from tdfscal.selfcal.suspicion import Suspicion, worst_angle


def misplaced(of: Estimate) -> tuple[Suspicion, ...]:
    """Name what contradicts the stated distances between hinges, with what it does to angles."""
    fit = of.fit
    used = np.flatnonzero(fit.weight > 0)
    seen = fit.at.seen.subset(used)
    variance = np.trace(seen.position_cov, axis1=2, axis2=3).mean(axis=1) / 3
    force = forces(fit.state, seen.force)
    found = examine(fit.rig, seen.position, variance, force, frames=True)
    places = layout(fit.rig.n, fit.state.motions)

    def move(cause: Cause) -> FloatArray:
        """How far the free parameters give way to it; rows of postures only."""
        if (hinge := displaced_hinges(fit.rig, cause)) is not None:
            white = fit.slopes[:, :, places["hinge"]] @ hinge.ravel()
        else:
            logged = np.zeros_like(fit.postures.position)
            logged[used] = shifted_positions(cause, seen.position, force)
            K = len(logged)
            white = np.einsum(
                "krp,kp->kr", fit.slopes[:, :, places["datum"]], logged.reshape(K, -1)
            )
        return np.asarray(of.parts.root @ (of.parts.left[: white.size].T @ white.ravel()))

    return suspected(fit.rig, of.uncertainty, found, move)


def suspected(
    rig: Rig, known: Uncertainty, found: Geometry, move: Callable[[Cause], FloatArray]
) -> tuple[Suspicion, ...]:
    """One suspicion of all causes that explain the distances, by the worst that one of them does.

    move : (p,), of the free parameters with a cause, rotations first.
    """
    if not found.causes:
        return ()
    moves = [move(cause) for cause in found.causes]
    shifts = [worst_angle(rig, known, each) for each in moves]
    worst = int(np.argmax([shift for shift, _, _ in shifts]))
    best = found.causes[0]
    return (
        Suspicion(
            found.findings(rig.supports),
            found.p_value,
            *shifts[worst],
            kind=best.kind,
            support=best.support,
            weight=best.statistic,
            move=moves[worst],
        ),
    )


def displaced_hinges(rig: Rig, cause: Cause) -> FloatArray | None:
    """Hinges' displacements (n, 3), m, LCS, by a cause that is one of the terminal."""
    if cause.kind == "scale":
        return np.asarray(cause.amount * (rig.hinge - rig.hinge.mean(axis=0)))
    if cause.kind != "hinge":
        return None
    out = np.zeros((rig.n, 3))
    out[cause.support] = cause.amount
    return out


def shifted_positions(cause: Cause, position: FloatArray, force: FloatArray) -> FloatArray:
    """What another cause adds to the logged positions (K, n, 3), m, BCS; force likewise, N."""
    if cause.kind == "compliance":
        return np.asarray(force * cause.amount[[0, 0, 1]])
    out = np.zeros_like(position)
    away = position[:, cause.support] - position[:, cause.support].mean(axis=0)
    error = np.tensordot(cause.amount, FRAMES[cause.kind], 1) if cause.kind in FRAMES else None
    out[:, cause.support] = cause.amount if error is None else away @ error.T
    return out
