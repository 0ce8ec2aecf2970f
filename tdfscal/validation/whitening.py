"""Residual wrenches with all that correlates them taken away."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import prior_std
from tdfscal.model.zero_motion import ZeroMotion
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Whitened:
    """Residual wrenches of K postures with all that correlates them taken away.

    residual : (m,), white; m is 6K, or as many as a motion determines. columns : (m, P), its
    derivative by the calibrated parameters; plain : the same, white in each posture's own noise
    only. own : (K, 6, 6), whitens each posture's own noise; K = 0 in motion, where a contact is
    found otherwise. common : (m, r), H of the inverse root I − H Hᵀ for the calibration's error,
    which is common to all postures. free : (m, f), orthonormal, directions of parameters that
    nobody knows; the residual has no part in them. rows : directions of all residuals that no
    unmeasured force reaches. sensors : n.
    """

    residual: FloatArray
    columns: FloatArray
    plain: FloatArray
    own: FloatArray
    common: FloatArray
    free: FloatArray
    rows: int
    sensors: int

    @property
    def chi2(self) -> float:
        """χ² of all residual wrenches together."""
        return float(self.residual @ self.residual)

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return int(self.rows - self.free.shape[1])

    @property
    def worth(self) -> float:
        """What one unknown has to lower χ² by (Schwarz)."""
        return float(np.log(max(self.rows, 2)))

    def white(self, columns: FloatArray) -> FloatArray:
        """Columns (6K, c), whitened posture by posture already, made white altogether."""
        white = columns - self.common @ (self.common.T @ columns)
        return np.asarray(white - self.free @ (self.free.T @ white))


def whiten(
    residual: FloatArray,
    columns: FloatArray,
    own: FloatArray,
    root: FloatArray,
    unknown: BoolArray,
    rows: int,
    sensors: int,
) -> Whitened:
    """Take away the error of the calibration from residuals that are white in their own noise.

    own : with 0 along forces that nobody measures; rows : how many directions that leaves.
    root : (P, r), U with U Uᵀ the covariance of the parameters. unknown : (P,), parameters of
    which nothing is known. The others are as those of `Whitened`, not white as a whole.

    With B the columns times U the covariance is I + B Bᵀ; by the singular values s of B its
    inverse root is I − V (1 − 1/√(1 + s²)) Vᵀ.
    """
    V, s, _ = np.linalg.svd(columns @ root, full_matrices=False)
    common, nothing = V * np.sqrt(1 - 1 / np.sqrt(1 + s**2)), np.zeros((len(columns), 0))
    start = Whitened(residual, columns, columns, own, common, nothing, rows, sensors)
    known = replace(start, free=basis(start.white(columns[:, unknown])))
    white = known.white(residual[:, None])[:, 0]
    return replace(known, residual=white, columns=known.white(columns))


def calibration_error(given: Calibrated, motion: ZeroMotion | None) -> tuple[FloatArray, BoolArray]:
    """Root (P + 3nG, r) of the covariance of a calibration's error, and what of it is unknown.

    motion : of the zeros in this log, to which it belongs alone: its amplitudes have their prior.
    """
    std = prior_std(given.rig, motion)[len(given.open) :]
    amplitudes = np.diag(np.where(np.isfinite(std), std, 0.0))
    return block_diagonal(given.root, amplitudes), np.concatenate([given.open, np.isinf(std)])


def basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what columns (m, c) span."""
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=0.0)])
