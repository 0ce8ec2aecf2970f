"""What a wrong geometry, known by the distances between hinges alone, does to the angles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.checks.geometry import Geometry
from tdfscal.checks.hinge_distances import FRAMES, Cause
from tdfscal.estimation.suspicion import Suspicion, worst_angle
from tdfscal.estimation.uncertainty import Estimate, F
from tdfscal.model.parameters import layout
from tdfscal.records import FloatArray, Rig


def misplaced(
    of: Estimate[F],
    found: Geometry,
    framed: Callable[[Cause], FloatArray] | None = None,
) -> tuple[Suspicion, ...]:
    """One suspicion of all causes that explain the distances, by the worst that one of them does.

    found : what the distances say. framed : whitened rows (m,) of a positioner's frame that is
    turned, scaled or not square, where distances are asked for that.
    """
    if not found.causes:
        return ()
    fit, parts = of.fit, of.parts
    slopes, p = fit.all_slopes(), int(fit.active.sum())
    places = layout(fit.rig.n, fit.still.motions)

    def move(cause: Cause) -> FloatArray:
        """How far the free parameters give way to it."""
        if framed is not None and cause.kind in FRAMES:
            white = framed(cause)
        else:
            step = np.zeros(slopes.shape[1])
            if (hinge := displaced_hinges(fit.rig, cause)) is not None:
                step[places["hinge"]] = hinge.ravel()
            elif cause.kind == "compliance":
                step[places["compliance"]] = cause.amount
            else:
                step[places["datum"]].reshape(-1, 3)[cause.support] = cause.amount
            white = slopes @ step
        return np.asarray(parts.root[:p] @ (parts.left[: len(white)].T @ white))

    moves = [move(cause) for cause in found.causes]
    shifts = [worst_angle(fit.rig, of.uncertainty, each) for each in moves]
    worst = int(np.argmax([shift for shift, _, _ in shifts]))
    best = found.causes[0]
    return (
        Suspicion(
            found.findings(fit.rig.supports),
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


def framed_positions(cause: Cause, position: FloatArray) -> FloatArray:
    """What a wrong frame of a positioner adds to the logged positions (K, n, 3), m, BCS."""
    out = np.zeros_like(position)
    away = position[:, cause.support] - position[:, cause.support].mean(axis=0)
    out[:, cause.support] = away @ np.tensordot(cause.amount, FRAMES[cause.kind], 1).T
    return out
