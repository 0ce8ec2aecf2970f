"""The equations that hold the distances between hinges, summed over postures; no force enters.

n hinges have 3n coordinates and a rigid terminal six freedoms, so that 3n − 6 equations per
posture are left. Seen in the LCS, and there across the rigid motions,

    R_kᵀ (p_ik − T_k) − r_i  =  δr_i + R_kᵀ (d_i + C F_ik + E_i (p_ik − p̄_i) + noise)

with hinges displaced by δr_i, datums d_i, supports that give by C, and E_i a positioner's frame
that is turned, scaled or not square. They are linear and enter by their sums, whose size does not
depend on the number of postures.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.model.statics import wrench
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile, chi2_sf
from tdfscal.numerics.least_squares import ask
from tdfscal.records import FloatArray
from tdfscal.significance import MOST_REJECTED

#: Positions are not known better than this, m: rounding, and a terminal that bends.
_FLOOR: Final = 2e-7
#: Ways in which a frame is wrong, with E of each of its components by one, (3, 3, 3).
FRAMES: Final[dict[str, FloatArray]] = {
    "turned": so3.hat(np.eye(3)),
    "scaled": np.eye(3)[:, :, None] * np.eye(3)[:, None],
    "not square": np.abs(so3.hat(np.eye(3))),
}
#: Share of a cause's best-known component that another must have to be known at all, and of the
#: equations' eigenvalues below which they are rounding.
_SEEN, _ROUNDING = 1e-6, 1e-10
#: A posture this many times farther from the others' middle than their median is a jolt.
_JOLT: Final = 100.0
#: A cause: its kind, its support, and how its unknowns move the parameters, (P, g).
Suspect = tuple[str, int | None, FloatArray]
#: Postures summed at once.
_CHUNK: Final = 1024


@record
class Cause:
    """One thing that may be wrong, and how well it alone explains the distances.

    kind : hinge, datum, scale, compliance, or a key of `FRAMES`. support : whose; None: of all.
    statistic : fall of χ², by so many `unknowns`. amount, std : (g,), m (hinge in the LCS, datum
    in the BCS), relative (scale, frames), or m/N lateral and vertical; ∞ where nothing is seen.
    """

    kind: str
    support: int | None
    statistic: float
    unknowns: int
    amount: FloatArray
    std: FloatArray

    @property
    def p_value(self) -> float:
        """That chance alone asks as much for this cause."""
        return float(chi2_sf(self.statistic, self.unknowns)) if self.unknowns else 1.0

    @property
    def weight(self) -> float:
        """Fall of χ² beyond its unknowns."""
        return self.statistic - self.unknowns


@record
class Equations:
    """Equations of all postures, summed: columns' products (P, P), with the misfit (P,), χ²."""

    gram: FloatArray
    score: FloatArray
    chi2: float
    rows: int

    def scaled(self, variance: float) -> Equations:
        """The same with the noise's variance this many times larger."""
        return Equations(
            self.gram / variance, self.score / variance, self.chi2 / variance, self.rows
        )

    def given(self, prior: FloatArray) -> Equations:
        """Whitened by what parameters with a prior std (P,), 0 exact, add to the noise."""
        scaled = prior[:, None] * self.gram
        inner = np.eye(len(prior)) + scaled * prior
        gain = np.linalg.solve(inner, np.column_stack([scaled, prior * self.score]))
        return self._less(prior[:, None] * gain)

    def apart_from(self, free: slice) -> tuple[Equations, int]:
        """Without what the parameters `free`, of which nothing is known, explain; their rank."""
        size = np.sqrt(np.diagonal(self.gram)[free])
        size = np.where(size > 0, size, 1.0)
        values, vectors = np.linalg.eigh(self.gram[free, free] / size[:, None] / size)
        seen = values > _ROUNDING * values[-1]
        half = vectors[:, seen] / np.sqrt(values[seen]) / size[:, None]
        gain = np.zeros((len(self.score), len(self.score) + 1))
        gain[free] = half @ (half.T @ np.column_stack([self.gram[free], self.score[free]]))
        return self._less(gain), int(seen.sum())

    def _less(self, gain: FloatArray) -> Equations:
        """Without what parameters take, gain (P, P + 1), of every column and of the misfit."""
        return Equations(
            self.gram - self.gram @ gain[:, :-1],
            self.score - self.gram @ gain[:, -1],
            self.chi2 - float(self.score @ gain[:, -1]),
            self.rows,
        )

    def ask(self, kind: str, support: int | None, columns: FloatArray) -> Cause:
        """Test a cause whose unknowns move the parameters by columns (P, g)."""
        information = columns.T @ self.gram @ columns
        own = np.trace(columns.T @ columns)  # a cause without any column is not seen
        floor = max(_SEEN * np.linalg.norm(information, 2), np.finfo(float).tiny * own)
        found = ask(information, columns.T @ self.score, floor)
        fall, unknowns = float(found.statistic), int(found.unknowns)
        return Cause(kind, support, fall, unknowns, found.amount, found.std)


def _across(hinge: FloatArray) -> FloatArray:
    """Orthonormal directions (n, 3, 3n − 6) of the hinges' places that no rigid motion moves."""
    arm = hinge - hinge.mean(axis=0)
    spokes = np.swapaxes(wrench(arm[None])[0], -1, -2).reshape(3 * len(hinge), 6)
    return np.linalg.qr(spokes, mode="complete")[0][:, 6:].reshape(len(hinge), 3, -1)


def without_jolts(
    hinge: FloatArray, position: FloatArray, variance: FloatArray
) -> FloatArray | slice:
    """Postures (a mask) whose shape is that of the others; all, where too many differ."""
    R, T = register(hinge, position)
    shape = np.einsum("kba,knb->kna", R, position - T[:, None])
    across = np.tensordot(shape, _across(hinge), axes=2)
    away = np.sum((across - np.median(across, axis=0)) ** 2, axis=1) / (variance + _FLOOR**2)
    usual = max(float(np.median(away)), float(chi2_quantile(0.5, across.shape[1])))
    keep = away <= _JOLT * usual
    return keep if np.mean(~keep) <= MOST_REJECTED else slice(None)


def equations(
    hinge: FloatArray, position: FloatArray, force: FloatArray, variance: FloatArray
) -> Equations:
    """Sum the equations of K postures.

    Columns: δr (3n), d (3n), compliance lateral and vertical, E of each positioner (9n).
    """
    n, across, centre = len(hinge), _across(hinge), position.mean(axis=0)
    m, ways = across.shape[2], np.concatenate(list(FRAMES.values()))
    total = np.zeros((15 * n + 3, 15 * n + 3))
    for first in range(0, len(position), _CHUNK):
        p, F = position[first : first + _CHUNK], force[first : first + _CHUNK]
        K, (R, T) = len(p), register(hinge, p)
        turned = np.einsum("iam,kba->kmib", across, R)  # a displacement in the BCS, seen across
        fixed = np.broadcast_to(across.transpose(2, 0, 1), (K, m, n, 3))
        off = np.tensordot(np.einsum("kba,knb->kna", R, p - T[:, None]) - hinge, across, axes=2)
        columns = [
            fixed.reshape(K, m, -1),
            turned.reshape(K, m, -1),
            np.einsum("kmib,kib->km", turned[..., :2], F[..., :2])[..., None],
            np.einsum("kmi,ki->km", turned[..., 2], F[..., 2])[..., None],
            np.einsum("kmib,wbc,kic->kmiw", turned, ways, p - centre, optimize=True).reshape(
                K, m, -1
            ),
            off[..., None],
        ]
        rows = np.concatenate(columns, axis=2)
        rows /= np.sqrt(variance[first : first + _CHUNK] + _FLOOR**2)[:, None, None]
        rows = rows.reshape(K * m, -1)
        total += rows.T @ rows
    return Equations(total[:-1, :-1], total[:-1, -1], float(total[-1, -1]), m * len(position))
