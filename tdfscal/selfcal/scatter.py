"""Noise beyond what is stated: whose is it? Variances held against each other by likelihood.

Each suspect adds a variance θ along known columns H of every posture's whitened residual r, so that
−2 ln L = Σ_k ln det C_k + rᵀ C⁻¹ r, C_k = I + θ H Hᵀ; restricted to what no parameter can follow
(REML: r at the best parameters for this θ, and + ln det JᵀC⁻¹J), for they follow the noise that was
weighted too high, and carry it elsewhere. How far it falls at the best θ says how well the suspect
explains the scatter; friction of the hinges shows in the moments alone, noise of the forces in
forces and moments, a sensor's own noise where its lever arm lets it.

References
----------
Patterson, Thompson: Recovery of inter-block information when block sizes are unequal. Biometrika
58 (1971) 545–554.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit

Kind = Literal["hinge friction", "force noise", "sensor noise", "position noise"]

#: Variances that are tried, in units of what equals the stated noise along the columns, before the
#: best is sought between the neighbours of the likeliest, by its logarithm to this tolerance.
_RATIO, _FINE = np.geomspace(1e-2, 1e5, 13), 0.03
#: Postures from which on the parameters follow next to none of the noise.
_MANY = 300
_ROUNDING = 1e-12
#: Standard deviations of the likelihood's slope below which no variance is sought.
_ASKED = 1.5


@dataclass(frozen=True, slots=True)
class Scatter:
    """A variance that the residuals ask for.

    support : of a sensor's noise. size : its standard deviation, N·m, N or m, per axis and posture;
    of a walk its intensity, N/√s.
    gain : by which −2 ln L falls, with one unknown. effect : (p,), standard deviation that it
    gives to each parameter.
    """

    kind: str
    support: int | None
    size: float
    gain: float
    effect: FloatArray


def scatters(fit: Fit, parts: Spectrum, root: FloatArray, residual: FloatArray) -> list[Scatter]:
    """All suspects, the likeliest first.

    root : (K, 6, 6), whitens a posture's residual; residual : (m,), whitened, postures first.
    """
    rows = 6 * len(root)
    white = residual[:rows].reshape(-1, 6)
    left = parts.left[:rows].reshape(*root.shape[:2], -1)
    found = []
    for kind, support, columns in _columns(fit, root):
        theta, gain = likeliest(columns, white, left)
        moved = parts.root @ np.einsum("kap,kab->pkb", left, columns).reshape(left.shape[2], -1)
        size = float(np.sqrt(theta))
        found.append(Scatter(kind, support, size, gain, size * np.linalg.norm(moved, axis=1)))
    return sorted(found, key=lambda scatter: -scatter.gain)


def _columns(fit: Fit, root: FloatArray) -> Iterator[tuple[Kind, int | None, FloatArray]]:
    """Whitened columns (K, 6, m) of one unit of each suspect's standard deviation."""
    at = fit.at
    yield "hinge friction", None, root[:, :, 3:]
    each = root[:, None] @ np.where(fit.postures.measured[:, None, :], at.noise_force, 0.0)
    for i in range(fit.rig.n):
        yield "sensor noise", i, each[:, i]
    yield "force noise", None, np.moveaxis(each, 1, 2).reshape(len(root), 6, -1)
    stated = float(np.trace(fit.postures.position_cov, axis1=2, axis2=3).mean()) / 3
    if stated > 0:
        values, vectors = np.linalg.eigh(at.turn_cov / stated)
        turn = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        yield "position noise", None, root @ at.noise_turn @ turn


def likeliest(columns: FloatArray, white: FloatArray, left: FloatArray) -> tuple[float, float]:
    """Variance θ ≥ 0 with the largest likelihood, and by how much it lowers −2 ln L.

    left : (K, 6, r), orthonormal with the prior's rows: what the parameters do to the residuals.
    """
    values, vectors = np.linalg.eigh(columns @ np.swapaxes(columns, 1, 2))
    values = np.maximum(values, 0.0)
    size = float(values.sum(axis=1).mean())
    if size <= 0:
        return 0.0, 0.0
    along = np.einsum("kab,ka->kb", vectors, white).ravel()
    turned = (np.swapaxes(vectors, 1, 2) @ left).reshape(len(along), -1)
    each = values.ravel()
    heard = each > _ROUNDING * each.max()  # what has no such variance stays as it is
    each, along, turned = each[heard], along[heard], turned[heard]
    # Slope of the likelihood at 0, against its own scatter: most sensors ask for nothing.
    asked = float(each @ (along**2 + np.sum(turned**2, axis=1) - 1.0))
    if asked < _ASKED * np.sqrt(2.0 * float(each @ each)):
        return 0.0, 0.0
    whole = (1.0 + _ROUNDING) * np.eye(turned.shape[1])

    def cost(logarithm: float) -> float:
        grown = 1.0 + np.exp(logarithm) * each
        total = float(np.sum(np.log(grown) + along**2 / grown))
        if len(values) > _MANY:
            return total
        # At the estimate the pull of all rows is 0, and their information is 1.
        lost = 1.0 - 1.0 / grown
        change, half = (along * lost) @ turned, np.sqrt(lost)[:, None] * turned
        lower = np.linalg.cholesky(whole - half.T @ half)
        pulled = np.linalg.solve(lower, change)
        return total - float(pulled @ pulled) + 2.0 * float(np.sum(np.log(np.diagonal(lower))))

    return lowest(cost, size, float(along @ along))


def lowest(cost: Callable[[float], float], size: float, at_zero: float) -> tuple[float, float]:
    """Variance θ ≥ 0 at which cost(ln θ) is lowest, and how far below its value at θ = 0.

    size : whitened variance that θ = 1 adds, on the mean.
    """
    from scipy.optimize import minimize_scalar  # slow to import, seldom needed

    tried = np.log(_RATIO / size)
    step = tried[1] - tried[0]
    near = min(tried, key=cost)
    best = minimize_scalar(
        cost, bounds=(near - step, near + step), method="bounded", options={"xatol": _FINE}
    )
    gain = at_zero - float(best.fun)
    return (float(np.exp(best.x)), gain) if gain > 0 else (0.0, 0.0)
