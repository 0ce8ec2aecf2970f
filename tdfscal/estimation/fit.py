"""A fit of whitened rows that are linear in the features of the model, and of the priors.

At rest a posture gives six rows, in motion a Fourier coefficient of a block does; both balances are
linear in features ψ(x) of one state x (theory, sections 2 and 8), so that all rows together are one
triangular factor R, as wide as there are features, with |R ψ(x)|² their χ². What the engine asks
of a fit, wherever its rows come from, stands in `Fitted`; what is stated of the parameters before
any posture are whitened rows, too.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import ClassVar, Protocol, TypeVar

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.parameters import (
    State,
    deviation,
    nominal,
    prior_std,
    rpy_prior_std,
    starting_state,
    vector,
)
from tdfscal.model.postures import ZeroMotion
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


class Stated(Protocol):
    """What is stated of all parameters (P′,) before anything is observed; `active` : free."""

    rig: Rig
    active: BoolArray


@record(kw_only=True)
class Fitted(ABC):
    """Rows at an estimate, and those of the priors: all that its uncertainty needs.

    The free parameters, p of P′, are in the order of `model.parameters.layout`, those of statics
    first, rotations before all.

    residual : of the rows at the estimate, jacobian : (…, p + …), by the free parameters and what
    is the log's own; not whitened. prior_residual : (m₀,), prior_jacobian : (m₀, p + …), whitened.
    """

    #: Whether the rows are those of a motion.
    moving: ClassVar[bool] = False
    priors: Stated
    residual: FloatArray
    jacobian: FloatArray
    prior_residual: FloatArray
    prior_jacobian: FloatArray
    iterations: int
    converged: bool

    @property
    def rig(self) -> Rig:
        """The rig."""
        return self.priors.rig

    @property
    def active(self) -> BoolArray:
        """Which parameters (P′,) are free."""
        return self.priors.active

    @property
    @abstractmethod
    def still(self) -> State:
        """Parameters of statics."""

    @property
    @abstractmethod
    def stated(self) -> Priors:
        """What is stated of the parameters of statics; its rows are the first of the priors'."""

    @property
    @abstractmethod
    def rows(self) -> int:
        """Number of independent residuals, without the priors'."""

    @property
    @abstractmethod
    def rms(self) -> tuple[float, float]:
        """Quadratic mean of the length of the residual force, N, and moment about c, N·m."""

    @property
    @abstractmethod
    def noise_pull(self) -> FloatArray:
        """Score (P′,) of all parameters that noise makes by standing in their columns."""

    @abstractmethod
    def whiten(self, columns: FloatArray) -> FloatArray:
        """Columns (…, c) of the rows as whitened rows (m − m₀, c)."""

    @abstractmethod
    def all_slopes(self) -> FloatArray:
        """Whitened derivative (m − m₀, P′) of the rows by all parameters, free or not."""

    @abstractmethod
    def noise_shares(self, posterior: FloatArray) -> dict[str, FloatArray]:
        """Covariance (p, p) of the free parameters by each source of noise.

        posterior : (p + …, p + …), of all that is estimated, by the rows as they are weighted.
        """

    @abstractmethod
    def noise_scale(self, birge: float, dof: int) -> tuple[float, float]:
        """By how much χ² widens the noise's variance, and that factor's degrees of freedom."""

    @abstractmethod
    def faked_information(self) -> FloatArray:
        """Information (3n, 3n) about the rotations that noise in the readings fakes."""

    @property
    def white(self) -> FloatArray:
        """Whitened residual (m,), priors last."""
        return np.concatenate([self.whiten(self.residual), self.prior_residual])

    def whitened(self) -> tuple[FloatArray, FloatArray]:
        """Whitened residual (m,) and Jacobian (m, p + …), priors last."""
        return self.white, np.concatenate([self.whiten(self.jacobian), self.prior_jacobian])

    @cached_property
    def factor(self) -> FloatArray:
        """Triangular factor (≤ p + …, p + …) of the rows' whitened Jacobian."""
        return triangular(self.whiten(self.jacobian))

    @property
    def cost(self) -> float:
        """χ² of rows and priors."""
        white = self.white
        return float(white @ white)


def information(of: Fitted) -> Spectrum:
    """Decompose the whitened Jacobian."""
    return spectrum(of.whitened()[1])


def factored_information(of: Fitted) -> Spectrum:
    """The same by the Jacobian's triangular factor, whose rows are no residuals: much faster."""
    whole = np.concatenate([of.factor, of.prior_jacobian])
    return spectrum(triangular(whole), len(of.white))


def solve(
    statistic: FloatArray,
    features: Rows[S],
    priors: Rows[S],
    move: Callable[[S, FloatArray], S],
    start: S,
    active: BoolArray,
    *,
    pull: FloatArray | None = None,
    iterations: int = STEPS,
) -> Solution[S]:
    """Gauss–Newton on a statistic (≤ q, q) and the priors.

    features : ψ (q,) and its derivative (q, P′). move : a state by a step (P′,). active : (P′,).
    pull : (q,), part of the score of the features that is taken away; default none.
    """
    offset: FloatArray | float = 0.0
    if pull is not None:
        offset = scored(statistic, features(start)[1], priors(start)[1], active, pull)

    def model(state: S) -> tuple[FloatArray, FloatArray]:
        psi, slope = features(state)
        prior_r, prior_j = priors(state)
        r, j = statistic @ psi, statistic @ slope[:, active]
        return np.concatenate([r, prior_r]) - offset, np.concatenate([j, prior_j])

    def moved(state: S, step: FloatArray) -> S:
        full = np.zeros(len(active))
        full[active] = step
        return move(state, full)

    return gauss_newton(model, moved, start, iterations=iterations)


def scored(
    statistic: FloatArray,
    slope: FloatArray,
    priors: FloatArray,
    active: BoolArray,
    pull: FloatArray,
) -> FloatArray:
    """Residuals (≤ q + m,) of a statistic and of priors whose score is that of features, (q,).

    slope : (q, P′), of the features. priors : (m, p), their rows.
    """
    J = np.concatenate([statistic @ slope[:, active], priors])
    parts = spectrum(J)
    return parts.left @ (parts.root.T @ (pull @ slope[:, active]))


class Priors:
    """Whitened rows of all priors with 0 < std < ∞, by the active parameters."""

    def __init__(self, rig: Rig, motion: ZeroMotion | None = None) -> None:
        std = self.full_std = prior_std(rig, motion)
        self.rig = rig
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
        #: Number of prior rows, and of the last of these that are earlier campaigns'.
        self.common = 0 if rig.earlier is None else len(rig.earlier.root)
        self.count = len(self.held) + len(self.angled) + self.common

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
        away = deviation(state, self.known)
        root = np.pad(root, ((0, 0), (0, len(away) - root.shape[1])))
        rows = root.copy()
        for i in range(state.n):  # d log(exp(δ) exp(v)) = J⁻¹(v) δ
            turn = slice(3 * i, 3 * i + 3)
            rows[:, turn] = root[:, turn] @ np.linalg.inv(so3.left_jacobian(away[turn]))
        return (
            np.concatenate([residual, root @ away]),
            np.concatenate([self.rows, rows[:, self.active]]),
        )
