"""A fit of whitened rows that are linear in the features of the model, and of the priors.

At rest a posture gives six rows, in motion a Fourier coefficient of a block does; both balances are
linear in features ψ(x) of one state x (theory, sections 2 and 8), so that all rows together are one
triangular factor R, as wide as there are features, with |R ψ(x)|² their χ². What the engine asks
of a fit, wherever its rows come from, stands in `Fitted`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from tdfscal.model.parameters import State
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
