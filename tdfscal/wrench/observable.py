"""Which directions of the contact wrench remain observable where sensors lack axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.calibrated import Calibrated
from tdfscal.model.statics import balance, free
from tdfscal.records import FloatArray
from tdfscal.wrench.contact_wrench import COMPONENTS, jacobian, measured, single, to_lcs

#: A coefficient below this, in 1 or m, is rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Observable:
    """Combinations of the contact wrench (LCS) that no unmeasured force reaches.

    rows : (r, 6), reduced row echelon form: a component, and the others that go with it.
    std : (r,), standard uncertainty from the calibration, N or N·m.
    """

    rows: FloatArray
    std: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Each combination in words, as `mz - 0.45 m fy`."""
        return tuple(_name(row) for row in self.rows)


def observable(given: Calibrated, position: FloatArray, force: FloatArray) -> Observable:
    """At one posture: position (n, 3), m, BCS; force (n, 3), readings, N."""
    at = balance(
        single(given, position[None], measured(given, force[None])),
        given.state,
        given.state.barycentre,
        given.rig.gravity,
    )
    T = to_lcs(at)[0]
    reach = T @ free(at.noise_force, given.rig.axes)[0]
    U, s, _ = np.linalg.svd(reach)
    rank = int(np.sum(s > _ROUNDING * s.max(initial=0.0))) if s.size else 0
    # Pivots: moments first, and last the forces that are reached most.
    order = [3, 4, 5, *np.argsort(np.linalg.norm(reach[:3], axis=1), kind="stable").tolist()]
    rows = _echelon(U[:, rank:].T, order)
    return Observable(rows, np.linalg.norm(rows @ jacobian(given, at)[0] @ given.root, axis=1))


def observable_text(given: Calibrated) -> str:
    """One sentence for the terminal level and at rest."""
    state = given.state
    share = -given.rig.gravity * float(state.mass) / given.rig.n
    upright = np.array([0.0, 0.0, -share])
    reading = np.einsum("nba,b->na", state.rotation, upright) + state.zero
    seen = observable(given, state.hinge + state.datum, reading)
    lacking = ", ".join(
        f"{''.join(a for a, has in zip('xyz', axes, strict=True) if not has)} of {name}"
        for name, axes in zip(given.rig.supports, given.rig.axes, strict=True)
        if not axes.all()
    )
    if not len(seen.rows):
        return f"without {lacking}, no direction of the contact wrench is observable"
    parts = [
        f"{name} (u = {std:.2g} {'N·m' if np.any(row[3:]) else 'N'})"
        for name, row, std in zip(seen.names, seen.rows, seen.std, strict=True)
    ]
    return (
        f"without {lacking}, {len(parts)} of 6 directions of the contact wrench remain observable "
        f"(terminal level): {', '.join(parts)}; components beside these have no uncertainty (empty)"
    )


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
    moment = bool(np.any(row[3:]))
    first = next(int(c) for c in (3, 4, 5, 0, 1, 2) if row[c] == 1)
    words = COMPONENTS[first]
    for c in (*range(3, 6), *range(3)):
        if c == first or not row[c]:
            continue
        unit = " m" if moment and c < 3 else ""
        words += f" {'-' if row[c] < 0 else '+'} {abs(row[c]):.3g}{unit} {COMPONENTS[c]}"
    return words
