"""Which directions of the contact wrench remain observable where sensors lack axes."""

from __future__ import annotations

import numpy as np

from tdfscal.model.calibrated import Calibrated
from tdfscal.model.statics import balance, free
from tdfscal.records import FloatArray
from tdfscal.wrench.contact_wrench import COMPONENTS, jacobian, measured, single, to_lcs

#: A coefficient below this, in 1 or m, is rounding.
_ROUNDING = 1e-6


def observable_text(given: Calibrated) -> str:
    """One sentence for the terminal level and at rest; some axis is not measured."""
    state = given.state
    share = -given.rig.gravity * float(state.mass) / given.rig.n
    upright = np.array([0.0, 0.0, -share])
    reading = np.einsum("nba,b->na", state.rotation, upright) + state.zero
    rows, std = _observable(given, state.hinge + state.datum, reading)
    lacking = ", ".join(
        f"{''.join(a for a, has in zip('xyz', axes, strict=True) if not has)} of {name}"
        for name, axes in zip(given.rig.supports, given.rig.axes, strict=True)
        if not axes.all()
    )
    if not len(rows):
        return f"without {lacking}, no direction of the contact wrench is observable"
    parts = [
        f"{_name(row)} (u = {own:.2g} {'N·m' if np.any(row[3:]) else 'N'})"
        for row, own in zip(rows, std, strict=True)
    ]
    return (
        f"without {lacking}, {len(parts)} of 6 directions of the contact wrench remain observable "
        f"(terminal level): {', '.join(parts)}; components beside these have no uncertainty (empty)"
    )


def _observable(
    given: Calibrated, position: FloatArray, force: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Combinations (r, 6) of the contact wrench (LCS) that no unmeasured force reaches.

    In reduced row echelon form: a component, and the others that go with it; and their standard
    uncertainty (r,) from the calibration, N or N·m. At one posture: position (n, 3), m, BCS;
    force (n, 3), readings, N.
    """
    state = given.state
    posture = single(given, position[None], measured(given, force[None]))
    at = balance(posture, state, state.barycentre, given.rig.gravity)
    reach = to_lcs(at)[0] @ free(at.noise_force, given.rig.axes)[0]
    U, s, _ = np.linalg.svd(reach)
    rank = int(np.sum(s > _ROUNDING * s.max()))
    # Pivots: moments first, and last the forces that are reached most.
    order = [3, 4, 5, *np.argsort(np.linalg.norm(reach[:3], axis=1), kind="stable").tolist()]
    rows = _echelon(U[:, rank:].T, order)
    return rows, np.linalg.norm(rows @ jacobian(given, at)[0] @ given.root, axis=1)


def _echelon(rows: FloatArray, order: list[int]) -> FloatArray:
    """Reduced row echelon form, its pivots in that order of the columns."""
    pivots: list[int] = []
    for column in order:
        more = [*pivots, column]
        if np.linalg.matrix_rank(rows[:, more], _ROUNDING) == len(more):
            pivots = more
    out = np.linalg.solve(rows[:, pivots], rows)
    out[:, pivots] = np.eye(len(rows))
    return np.where(np.abs(out) < _ROUNDING, 0.0, out)


def _name(row: FloatArray) -> str:
    """A combination in words, as `mz - 0.45 m fy`."""
    moment = bool(np.any(row[3:]))
    first = next(int(c) for c in (3, 4, 5, 0, 1, 2) if row[c] == 1)
    words = COMPONENTS[first]
    for c in (*range(3, 6), *range(3)):
        if c == first or not row[c]:
            continue
        unit = " m" if moment and c < 3 else ""
        words += f" {'-' if row[c] < 0 else '+'} {abs(row[c]):.3g}{unit} {COMPONENTS[c]}"
    return words
