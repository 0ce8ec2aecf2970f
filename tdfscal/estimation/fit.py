"""A fit of whitened rows that are linear in the features of the model, and of the priors.

At rest a posture gives six rows, in motion a Fourier coefficient of a block does; both balances are
linear in features ψ(x) of one state x (theory, sections 2 and 8), so that all rows together are one
triangular factor R, as wide as there are features, with |R ψ(x)|² their χ². What the engine asks
of a fit, wherever its rows come from, stands in `Fitted`; what is stated of the parameters before
any posture are whitened rows, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

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
from tdfscal.numerics.least_squares import (
    STEPS,
    Solution,
    Spectrum,
    gauss_newton,
    spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray, Rig

S = TypeVar("S")
#: Residual (m,) and Jacobian (m, p) at a state.
Rows = Callable[[S], tuple[FloatArray, FloatArray]]


class Fitted(Protocol):
    """Whitened rows at an estimate, m of them, the last m₀ of which are the priors'.

    active : (P′,), which parameters are free, p of them; those of statics first, in the order of
    `model.parameters.layout`, rotations before all. still : the parameters of statics.
    """

    @property
    def rig(self) -> Rig:
        """The rig."""

    @property
    def active(self) -> BoolArray:
        """Free parameters (P′,)."""

    @property
    def still(self) -> State:
        """Parameters of statics."""

    @property
    def rows(self) -> int:
        """Number of independent residuals, without the priors'."""

    @property
    def rms(self) -> tuple[float, float]:
        """Quadratic mean of the length of the residual force, N, and moment about c, N·m."""

    @property
    def cost(self) -> float:
        """χ² of all rows."""

    @property
    def still_priors(self) -> int:
        """How many of the prior rows are those of statics, which come first."""

    @property
    def prior_jacobian(self) -> FloatArray:
        """Whitened prior rows (m₀, p + …)."""

    @property
    def white(self) -> FloatArray:
        """Residual (m,)."""

    def whitened(self) -> tuple[FloatArray, FloatArray]:
        """Residual (m,), Jacobian (m, p + …) by the free parameters and what is the log's own."""

    def all_slopes(self) -> FloatArray:
        """Whitened derivative (m − m₀, P′) of the rows by all parameters, free or not."""


def information(of: Fitted) -> Spectrum:
    """Decompose the whitened Jacobian."""
    return spectrum(of.whitened()[1])


def factored_information(of: Fitted) -> Spectrum:
    """The same by the Jacobian's triangular factor, whose rows are no residuals: much faster."""
    J = of.whitened()[1]
    return spectrum(triangular(J), len(J))


def solve(
    statistic: FloatArray,
    features: Rows[S],
    priors: Rows[S],
    move: Callable[[S, FloatArray], S],
    start: S,
    active: BoolArray,
    *,
    iterations: int = STEPS,
) -> Solution[S]:
    """Gauss–Newton on a statistic (≤ q, q) and the priors.

    features : ψ (q,) and its derivative (q, P′). move : a state by a step (P′,). active : (P′,).
    """

    def model(state: S) -> tuple[FloatArray, FloatArray]:
        psi, slope = features(state)
        prior_r, prior_j = priors(state)
        r, j = statistic @ psi, statistic @ slope[:, active]
        return np.concatenate([r, prior_r]), np.concatenate([j, prior_j])

    def moved(state: S, step: FloatArray) -> S:
        full = np.zeros(len(active))
        full[active] = step
        return move(state, full)

    return gauss_newton(model, moved, start, iterations=iterations)


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
