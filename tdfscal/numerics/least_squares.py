"""Gauss–Newton with Levenberg's damping on any manifold that offers a retraction.

Values that nobody measures, free in one block of rows alone, are eliminated block by block: with
e = e_0 + N u + noise the rows of the whitened e across N's columns do not see u, whatever it is;
along them they say nothing else. So a missing reading costs equations and adds no parameter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from tdfscal.frozen import record
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray, IntArray

S = TypeVar("S")

#: A step is converged when it changes the whitened residual by less than this many standard
#: deviations, a millionth of any parameter's own uncertainty; the step after it would be far less.
TOLERANCE = 1e-6
#: A step shorter than this, in standard uncertainties, is near the minimum.
_NEAR = 0.1
#: Steps at most.
STEPS = 60
#: A component below which no direction that is seen has it.
_BLIND = 1e-6
#: Share of the columns' size below which what stands out of the fit's is rounding.
NOISE_ONLY = 1e-9
#: Rows that are factored at once.
_CHUNK = 1_200


@record
class Solution(Generic[S]):
    """The end of an iteration.

    residual : (m,), whitened. jacobian : (m, p). cost : |residual|².
    converged : the last step was below the tolerance; otherwise the iteration ran out.
    """

    state: S
    residual: FloatArray
    jacobian: FloatArray
    cost: float
    iterations: int
    converged: bool


@record
class Spectrum:
    """Singular value decomposition of a Jacobian (m, p) with its columns scaled to unit length.

    scale : (p,). values : (r,), those above rounding. right : (r, p). null : (p − r, p), the
    directions that no row of the Jacobian sees, in scaled parameters.
    """

    scale: FloatArray
    left: FloatArray
    values: FloatArray
    right: FloatArray
    null: FloatArray

    @property
    def root(self) -> FloatArray:
        """G (p, r) with the pseudo-inverse of JᵀJ equal to G Gᵀ."""
        return np.asarray((self.right / self.values[:, None]).T / self.scale[:, None])

    def solve(self, residual: FloatArray, damping: float = 0.0) -> FloatArray:
        """Step (p,) that minimises |J x + residual|² + damping |scale · x|²."""
        gain = self.values / (self.values**2 + damping)
        return np.asarray(-(self.right.T @ (gain * (self.left.T @ residual))) / self.scale)


def spectrum(jacobian: FloatArray, rows: int = 0) -> Spectrum:
    """Decompose a Jacobian; directions below its rounding errors are its null space.

    rows : of what it is the triangular factor of, where it is one. The cut lies at rounding
    (machine epsilon times size), not at a size of information: whether a direction is known *well
    enough* is decided from its standard uncertainty, elsewhere.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    U, s, Vt = np.linalg.svd(jacobian / scale, full_matrices=jacobian.shape[0] < jacobian.shape[1])
    size = max(rows, *jacobian.shape)
    cut = s[0] * size * np.finfo(float).eps * 8 if len(s) else 0.0
    rank = int(np.sum(s > cut))
    return Spectrum(scale, U[:, :rank], s[:rank], Vt[:rank], Vt[rank:])


@record
class Asked:
    """How far residuals go to meet further columns, batched over leading axes.

    statistic : (...), fall of χ² (Rao 1948), by so many `unknowns` (...). amount, std : (..., g); ∞
    where nothing is seen. root : (..., g, g), of the amounts' covariance where something is.
    """

    statistic: FloatArray
    unknowns: IntArray
    amount: FloatArray
    std: FloatArray
    root: FloatArray

    def p_value(self, chi2: float, dof: int) -> float:
        """Held against the scatter that remains without it, or it would excuse itself.

        chi2, dof : of the fit without the columns.
        """
        if not self.unknowns:
            return 1.0
        rest = (chi2 - self.statistic) / max(dof - int(self.unknowns), 1)
        return float(chi2_sf(self.statistic / np.maximum(1.0, rest), self.unknowns))

    def weight(self, rows: int) -> float:
        """Fall of −2 ln L less what the unknowns are worth among so many residuals."""
        return float(self.statistic - self.unknowns * np.log(max(rows, 2)))


def ask(information: FloatArray, score: FloatArray, floor: FloatArray | float) -> Asked:
    """Test columns by their information A (..., g, g) and score s (..., g) beyond a fit's.

    The statistic is sᵀA⁺s, the amount A⁺s.
    floor : (...), information below which a direction is rounding.
    """
    values, vectors = np.linalg.eigh(information)
    seen = values > np.asarray(floor)[..., None]
    along = (np.swapaxes(vectors, -1, -2) @ score[..., None])[..., 0]
    gain = np.divide(along, values, out=np.zeros_like(along), where=seen)
    half = np.divide(vectors, np.sqrt(np.where(seen, values, np.inf))[..., None, :])
    blind = np.where(seen[..., None, :], 0.0, np.abs(vectors)).max(axis=-1, initial=0.0) > _BLIND
    return Asked(
        statistic=np.sum(gain * along, axis=-1),
        unknowns=seen.sum(axis=-1),
        amount=(vectors @ gain[..., None])[..., 0],
        std=np.where(blind, np.inf, np.linalg.norm(half, axis=-1)),
        root=half,
    )


def ask_beside(own: FloatArray, score: FloatArray, known: FloatArray) -> Asked:
    """Test columns c beside parameters that follow them: cᵀc (..., g, g), and score (..., g).

    known : (..., g, r), cᵀJ times a root of the parameters' covariance.
    """
    floor = NOISE_ONLY * np.maximum(np.trace(own, axis1=-2, axis2=-1), np.finfo(float).tiny)
    return ask(own - known @ np.swapaxes(known, -1, -2), score, floor)


def gram_root(gram: FloatArray, rows: int) -> FloatArray:
    """G (p, r) with the pseudo-inverse of JᵀJ (p, p) equal to G Gᵀ; rows : of J.

    Many times faster than `spectrum` for tall J, and blind below the root of its rounding:
    for weights that are iterated, not for what is stated.
    """
    scale = np.sqrt(np.diagonal(gram))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    kept = values > values[-1] * max(rows, len(gram)) * np.finfo(float).eps
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None])


def covariance_root(cov: FloatArray) -> FloatArray:
    """U (..., m, m) with U Uᵀ the covariances (..., m, m), zero variances included."""
    values, vectors = np.linalg.eigh(cov)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def triangular(rows: FloatArray) -> FloatArray:
    """R (min(m, p), p), upper triangular, with RᵀR equal to rowsᵀ rows (m, p).

    Chunk by chunk, of a size that stays in a cache: four times faster for many rows.
    """
    chunk = max(_CHUNK, 4 * rows.shape[1])
    while len(rows) > 2 * chunk:
        parts = [rows[first : first + chunk] for first in range(0, len(rows), chunk)]
        rows = np.concatenate([np.linalg.qr(part, mode="r") for part in parts])
    return np.asarray(np.linalg.qr(rows, mode="r"))


def block_diagonal(*blocks: FloatArray) -> FloatArray:
    """Matrices (a, p), (b, q), … along the diagonal of one, (a + b + …, p + q + …)."""
    ends = np.cumsum([block.shape for block in blocks], axis=0)
    out = np.zeros(ends[-1])
    for (row, column), block in zip(ends, blocks, strict=True):
        out[row - block.shape[0] : row, column - block.shape[1] : column] = block
    return out


def gauss_newton(
    model: Callable[[S], tuple[FloatArray, FloatArray]],
    retract: Callable[[S, FloatArray], S],
    start: S,
    *,
    iterations: int = STEPS,
) -> Solution[S]:
    """Minimise |residual(state)|², where model returns the whitened residual and its Jacobian.

    Full Gauss–Newton steps while they descend; Levenberg's damping where they do not. Near the
    minimum a step is as long as the one before it shows (Barzilai & Borwein, IMA J. Numer. Anal. 8,
    1988): in a direction of which little is known the residuals' curvature, which these steps leave
    out, outweighs what is, and whole steps overshoot. Directions without any information are left
    where they started.
    """
    state, damping = start, 0.0
    residual, jacobian = model(state)
    last = moved = np.zeros(len(residual))
    cost = float(residual @ residual)
    for iteration in range(1, iterations + 1):
        parts = spectrum(jacobian)
        whole = -parts.left @ (parts.left.T @ residual)
        share = _share(whole - last, moved) if np.linalg.norm(whole) < _NEAR else 1.0
        last = whole
        while True:
            step = share * parts.solve(residual, damping)
            predicted = float(np.linalg.norm(jacobian @ step))
            trial = retract(state, step)
            new_residual, new_jacobian = model(trial)
            new_cost = float(new_residual @ new_residual)
            if new_cost < cost or predicted < TOLERANCE * (1 + np.sqrt(cost)):
                break
            damping = max(10 * damping, 1e-6)
            if damping > 1e8:
                return Solution(state, residual, jacobian, cost, iteration, False)
        moved = jacobian @ step
        state, residual, jacobian, cost = trial, new_residual, new_jacobian, new_cost
        if predicted < share * TOLERANCE and damping < 1e-9:
            return Solution(state, residual, jacobian, cost, iteration, True)
        damping = 0.0 if damping < 1e-5 else damping / 30
    return Solution(state, residual, jacobian, cost, iterations, False)


def _share(change: FloatArray, moved: FloatArray) -> float:
    """The part of a whole step to make; change : by the last one, `moved`, (m,) in residuals."""
    curved = -float(change @ moved)
    return float(np.clip(moved @ moved / curved, 0.1, 1.0)) if curved > 1.5 * moved @ moved else 1.0


#: A direction whose share of the columns is below this is rounding.
_REACHED = 1e-9


def whitener(cov: FloatArray, columns: FloatArray) -> tuple[FloatArray, IntArray]:
    """V (K, 6, 6) with V cov Vᵀ a projector on what the columns do not reach, and its rank (K,).

    cov : (K, 6, 6). columns : (K, 6, m).
    """
    inverse_root = np.linalg.inv(np.linalg.cholesky(cov))
    rows = np.full(len(cov), cov.shape[-1])
    if not columns.shape[2]:
        return inverse_root, rows
    U, s, _ = np.linalg.svd(inverse_root @ columns, full_matrices=False)
    reached = s > _REACHED * s.max(axis=1, keepdims=True)
    U = np.where(reached[:, None], U, 0.0)
    return inverse_root - U @ (np.swapaxes(U, 1, 2) @ inverse_root), rows - reached.sum(axis=1)


def free_values(
    cov: FloatArray, columns: FloatArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Smallest free forces u (K, m) that the residual (K, 6) asks for, and their covariance."""
    inverse_root = np.linalg.inv(np.linalg.cholesky(cov))
    white = inverse_root @ columns
    inverse = np.linalg.pinv(white, rcond=_REACHED)
    value = -(inverse @ (inverse_root @ residual[..., None]))[..., 0]
    return value, np.asarray(inverse @ np.swapaxes(inverse, 1, 2))
