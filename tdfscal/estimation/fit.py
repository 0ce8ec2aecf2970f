"""A fit of whitened rows that are linear in the features of the model, and of the priors.

At rest a posture gives six rows, in motion a Fourier coefficient of a block does; both balances are
linear in features ψ(x) of one state x (theory, sections 2 and 8), so that all rows together are one
triangular factor R, as wide as there are features, with |R ψ(x)|² their χ². What the engine asks
of a fit, wherever its rows come from, stands in `Fitted`; what is stated of the parameters before
any posture are whitened rows, too.

What one campaign says of the rig's constants is an `Observation`, a quadratic form: its own
quantities (zeros) are eliminated by a Schur complement; what is left is the information on the
rig's constants, counted from a common reference. Rotations, hinges, datums,
sensitivities, the direction of gravity and a load stated alike have one realisation in all
campaigns: they are pooled together, since pooled on the rotations alone a hinge's error would seem
to average out. Information adds; a campaign that determines nothing by itself adds what it has.

C active constants in the order of `model.parameters.layout`; the 3n rotations come first, rad.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated, free_constants
from tdfscal.model.parameters import (
    LOAD,
    State,
    constants,
    deviation,
    furthest,
    layout,
    nominal,
    parameter_count,
    prior_std,
    rpy_prior_std,
    starting_state,
    vector,
    with_motions,
)
from tdfscal.model.postures import ZeroMotion
from tdfscal.numerics import so3
from tdfscal.numerics.information import Contrast, Information, inverse, nothing, without
from tdfscal.numerics.least_squares import (
    STEPS,
    Solution,
    Spectrum,
    gauss_newton,
    spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray, Rig, Rotations

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


#: A share of a direction that no row sees below this is rounding.
_OPEN = 1e-6


@record
class Observation:
    """What was observed of the rig's constants; observations add.

    A campaign at rest or in motion, or a survey, its own parameters eliminated at a state.

    chi2 : with the constants at the reference and the own parameters at their best. rows : number
    of residuals, own priors included, less the own parameters that they determine.
    places : (P,), which parameters are the campaign's own. own : (o,), their step at the reference;
    give : (o, C), their change per change of the constants. spread : (o, o), their covariance where
    the constants are known. open : (o,), of which the campaign says nothing.
    """

    information: Information
    chi2: float
    rows: int
    places: BoolArray
    own: FloatArray
    give: FloatArray
    spread: FloatArray
    open: BoolArray


def eliminate(of: Fitted, reference: State, pull: FloatArray) -> Observation:
    """Reduce a campaign to its constants (C,), counted from the reference's; priors of the
    constants are left out, those of its own parameters are kept.

    of : a fit whose parameters are those of statics. pull : (P,), part of their score that noise
    makes.
    """
    shared = np.pad(free_constants(of.rig), (0, len(of.active) - parameter_count(of.rig.n)))
    common = shared[of.active]
    own_rows = np.asarray(np.abs(of.prior_jacobian[:, ~common]).any(axis=1))
    r, J = of.whitened()
    kept = np.concatenate([np.ones(len(r) - len(own_rows), dtype=np.bool_), own_rows])
    r, J = r[kept], J[kept]
    # Residual at the reference's constants, to the first order.
    away = deviation(of.still, with_motions(reference, of.still.motions))[of.active][common]
    A, B = J[:, common], J[:, ~common]
    r = r - A @ away
    scale = np.linalg.norm(B, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    U, s, Vt = np.linalg.svd(B / scale, full_matrices=True)
    rank = int(np.sum(s > s[0] * max(B.shape) * np.finfo(float).eps * 8)) if len(s) else 0
    U = U[:, :rank]
    back = -(Vt[:rank].T / s[:rank]) @ U.T / scale[:, None]
    free_A, free_r = A - U @ (U.T @ A), r - U @ (U.T @ r)
    give, spread = back @ A, back @ back.T
    by_noise, by_own = pull[of.active][common], pull[of.active][~common]
    return Observation(
        information=Information(free_A.T @ free_A, by_noise + give.T @ by_own - free_A.T @ free_r),
        chi2=float(free_r @ free_r),
        rows=of.rows + int(own_rows.sum()) - rank,
        places=of.active & ~shared,
        own=back @ r + spread @ by_own,
        give=give,
        spread=spread,
        open=np.abs(Vt[rank:]).max(axis=0, initial=0.0) > _OPEN,
    )


def of_survey(survey: Rotations, reference: State, size: int) -> Observation:
    """What an estimate of the rotations alone says, as a tracker's survey gives it."""
    n = len(survey.rotation)
    away = so3.log(survey.rotation @ np.swapaxes(reference.rotation, 1, 2)).ravel()
    out = nothing(size)
    matrix = np.linalg.inv(survey.covariance)
    out.matrix[: 3 * n, : 3 * n] = (matrix + matrix.T) / 2
    out.score[: 3 * n] = out.matrix[: 3 * n, : 3 * n] @ away
    return _alone(out, np.zeros(0, dtype=np.bool_), np.zeros((0, size)), np.zeros((0, 0)), away)


def of_estimate(known: Calibrated, prior: Information, reference: State) -> Observation:
    """What a campaign says that was calibrated by itself, as one in motion is.

    Its posterior less its prior (C, C) of the constants, both counted from the reference: the noise
    of its rows was estimated with them, so that no χ² of its own remains.
    """
    free = free_constants(known.rig)
    places = ~free & (prior_std(known.rig) > 0)
    C = known.covariance
    posterior = inverse(C[np.ix_(free, free)])
    away = deviation(known.state, reference)[free]
    found = without(Information(posterior, posterior @ away), prior)
    give = C[np.ix_(places, free)] @ posterior
    spread = C[np.ix_(places, places)] - give @ C[np.ix_(free, places)]
    return _alone(found, places, give, spread, away)


def _alone(
    found: Information, places: BoolArray, give: FloatArray, spread: FloatArray, away: FloatArray
) -> Observation:
    """An estimate without residuals: χ² is its distance from the reference."""
    chi2, rank = Contrast(found.matrix, found.score).chi2()
    return Observation(
        information=found,
        chi2=chi2,
        rows=rank,
        places=places,
        own=-give @ away if len(give) else np.zeros(0),
        give=give,
        spread=spread,
        open=np.zeros(len(give), dtype=np.bool_),
    )


def stated(priors: Priors, reference: State) -> Information:
    """What the rig file, or an earlier calibration, says of the constants, counted once."""
    n = reference.n
    common = constants(n)[priors.active]
    residual, rows = priors(reference)
    rows = rows[:, common]
    here = np.abs(rows).any(axis=1)
    matrix = rows[here].T @ rows[here]
    matrix += np.diag(furthest(n)[priors.active & constants(n)] ** -2.0)
    return Information(matrix, -(rows[here].T @ residual[here]))


def unstated(priors: Priors, *, load_alone: bool = False) -> int:
    """Count the free constants that have no prior of their own; of the terminal alone, if asked."""
    std, n = priors.full_std, len(priors.nominal)
    if load_alone:
        return sum(int(np.isinf(std[layout(n)[group]]).sum()) for group in LOAD)
    open_std = np.isinf(std) & constants(n)
    return int(open_std.sum()) - len(priors.angled)
