"""What is stated of the parameters before any posture, as whitened rows."""

from __future__ import annotations

import numpy as np

from tdfscal.model.parameters import (
    State,
    constants,
    deviation,
    nominal,
    prior_std,
    rpy_prior_std,
    starting_state,
    vector,
)
from tdfscal.model.zero_motion import ZeroMotion
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig


class Priors:
    """Whitened rows of all priors with 0 < std < ∞, by the active parameters."""

    def __init__(self, rig: Rig, motion: ZeroMotion | None = None) -> None:
        std = self.full_std = prior_std(rig, motion)
        self.active = std > 0
        motions = 0 if motion is None else len(motion.std)
        self.mean = vector(nominal(rig, motions))
        self.held = np.flatnonzero(np.isfinite(std) & self.active)
        self.std = std[self.held]
        self.rows = np.zeros((len(self.held), len(std)))
        self.rows[np.arange(len(self.held)), self.held] = 1 / self.std
        self.rows = self.rows[:, self.active]
        self.nominal, self.rpy_std = so3.from_rpy(rig.nominal_rpy), rpy_prior_std(rig)
        self.earlier, self.known = rig.earlier, starting_state(rig, motions)
        own = np.isfinite(self.rpy_std).ravel() & (rig.earlier is None)
        self.angled = np.flatnonzero(own)

    def __call__(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Residual (m,) and Jacobian (m, p)."""
        residual = (vector(state) - self.mean)[self.held] / self.std
        if self.earlier is not None:
            return self._with_earlier(state, self.earlier.root, residual)
        if not len(self.angled):
            return residual, self.rows
        # A prior on roll, pitch, yaw about the nominal mounting.
        turn = so3.deviations(state.rotation, self.nominal)
        jac = np.zeros((3 * state.n, self.rows.shape[1]))
        blocks = so3.rpy_jacobian(state.rotation)
        blocks[so3.locked(self.nominal)] = np.eye(3)  # turns about the BCS's axes instead
        for i, block in enumerate(blocks):
            jac[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        scale = self.rpy_std.ravel()[self.angled]
        return (
            np.concatenate([residual, turn.ravel()[self.angled] / scale]),
            np.concatenate([self.rows, jac[self.angled] / scale[:, None]]),
        )

    def _with_earlier(
        self, state: State, root: FloatArray, residual: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Own rows, and last the rows of earlier campaigns: W log(X X̂ᵀ), W (x − x̂)."""
        away = np.where(constants(state.n, state.motions), deviation(state, self.known), 0.0)
        root = np.pad(root, ((0, 0), (0, len(away) - root.shape[1])))
        rows = root.copy()
        for i in range(state.n):  # d log(exp(δ) exp(v)) = J⁻¹(v) δ
            turn = slice(3 * i, 3 * i + 3)
            rows[:, turn] = root[:, turn] @ np.linalg.inv(so3.left_jacobian(away[turn]))
        return (
            np.concatenate([residual, root @ away]),
            np.concatenate([self.rows, rows[:, self.active]]),
        )
