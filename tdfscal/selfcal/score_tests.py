"""Score tests of static postures: their suspects, and noise held against them.

What the tests speak for is held against all kinds of noise and zeros that wander.

Noise beyond what is stated: whose is it? Variances held against each other by likelihood.

Each suspect adds a variance θ along known columns H of the whitened residual r, so that −2 ln L =
ln det C + rᵀ C⁻¹ r, C = I + θ H Hᵀ; restricted to what no parameter can follow (REML: r at the best
parameters for this θ, and + ln det JᵀC⁻¹J), for they follow the noise that was weighted too high,
and carry it elsewhere. How far it falls at the best θ says how well the suspect explains the
scatter; friction of the hinges shows in the moments alone, noise of the forces in forces and
moments, a sensor's own noise where its lever arm lets it, posture by posture. Zeros that wander
make noise that goes together from posture to posture: H are a walk's modes (Karhunen–Loève) through
the zeros' columns, of intensity √θ, and with the eigenvalues s and vectors v of HᵀH, of what no
parameter follows, and a = vᵀ Hᵀ r / √s

    −2 ln L(θ) = Σ ln(1 + θ s) + a² / (1 + θ s).

References
----------
Patterson, Thompson: Recovery of inter-block information when block sizes are unequal. Biometrika
58 (1971) 545–554.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal.estimation.score_tests import (
    Suspect,
    Suspicion,
    likeliest,
    moving_zeros,
    speaking,
    stated_suspects,
    suspicion,
    undeclared_zeros,
)
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.model.parameters import layout
from tdfscal.model.postures import walk_modes
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import covariance_root
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import ROWS, Fit
from tdfscal.significance import MISFIT, UNDECLARED_ERROR, UNDECLARED_FRICTION_SHARE


def suspicions(
    of: Estimate[Fit], time: FloatArray, temperature: FloatArray | None = None
) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely.

    time : (K,), s, when each posture was held. temperature : (K, n), °C, where it is known.
    """
    fit = of.fit
    own = [*_scales(fit), *_moving_zeros(fit, time, temperature), *_pushes(fit)]
    found = speaking(of, [*stated_suspects(fit), *own], other=UNDECLARED_FRICTION_SHARE)
    sticking = (doubt.p_value for doubt in scatters(of, "hinge friction"))
    level = UNDECLARED_ERROR * UNDECLARED_FRICTION_SHARE
    if of.quality.p_value < MISFIT or min(sticking, default=1.0) <= level:
        found += scatters(of)
    if found:
        found += wandering(of, time)
    # At rest no covariance holds their moves.
    return likeliest([replace(doubt, move=None) for doubt in found])


def _moving_zeros(fit: Fit, time: FloatArray, temperature: FloatArray | None) -> Iterator[Suspect]:
    """Zeros that move, where none are declared to."""
    rig, priors = fit.rig, len(fit.prior_residual)
    columns = np.pad(fit.all_slopes()[:, layout(rig.n)["zero"]], ((0, priors), (0, 0)))
    zeros = columns.reshape(-1, rig.n, 3)
    for group, shape, unit in undeclared_zeros(rig.drift, time, temperature):
        each = np.pad(np.repeat(shape, ROWS, axis=0), ((0, priors), (0, 0)))
        yield from moving_zeros(group, zeros * each[..., None], unit)


def _scales(fit: Fit) -> Iterator[Suspect]:
    """Vertical axes of positioners that truly travel 1 + s times what is logged.

    The distances between hinges tell of the others. A hinge stands at position − datum, so that s
    is a datum of −s times the travel; what is constant of it is a datum's.
    """
    used, height = fit.weight > 0, fit.postures.position[..., 2]
    travel = np.repeat(height - height[used].mean(axis=0), ROWS, axis=0)
    by_datum = fit.all_slopes()[:, layout(fit.rig.n)["datum"]]
    columns = np.pad(-by_datum[:, 2::3] * travel, ((0, len(fit.prior_residual)), (0, 0)))
    for i in range(fit.rig.n):
        # Noise of the readings stands in it alike in all postures: over the travel it cancels.
        yield "vertical scale", i, columns[:, [i]], 1.0, 0.0


def _pushes(fit: Fit) -> Iterator[Suspect]:
    """A wrench on the terminal, alike in the LCS of all postures; no readings stand in it.

    What it shares with load, zeros and gravity their priors leave to them.
    """
    columns = np.pad(fit.by_wrench.reshape(-1, 6), ((0, len(fit.prior_residual)), (0, 0)))
    yield "push", 0, columns, np.repeat([1.0, 0.0], 3), 0.0


#: Variances that are tried, in units of what adds that of the stated noise to all rows, before the
#: best is sought between the neighbours of the likeliest, by its logarithm to this tolerance.
_TRIED, _FINE = np.log(np.geomspace(1e-2, 1e5, 13) / ROWS), 0.03
#: Postures from which on the parameters follow next to none of the noise.
_MANY = 300
#: Share of the largest variance along a column below which there is none.
_ROUNDING = 1e-12
#: Standard deviations of the likelihood's slope below which no variance is sought.
_ASKED = 1.5
#: Columns of walks that are looked at, of the slowest modes of all channels together: ten modes
#: already hold 96 % of a walk's variance.
_COLUMNS, _COLUMNS_OF_MANY = 1200, 180
#: Of a walk's intensity, N/√h in N/√s.
_ROOT_HOUR = 60.0


def scatters(of: Estimate[Fit], kind: str = "") -> list[Suspicion]:
    """All noise that is white from posture to posture, each with the size that it may have.

    kind : the only one that is asked for.
    """
    asked = (each for each in noise_columns(of.fit) if not kind or each[0] == kind)
    return _variances(of, len(of.fit.weight), ((*each, 1.0) for each in asked))


def wandering(of: Estimate[Fit], time: FloatArray) -> list[Suspicion]:
    """Walks of all zeros, and of each sensor's; none where one is declared.

    time : (K,), s, when each posture was held.
    """
    if of.fit.rig.drift.walk > 0:
        return []
    return _variances(of, 1, ((*each, _ROOT_HOUR) for each in _walks(of.fit, time)))


def _variances(
    of: Estimate[Fit], groups: int, suspects: Iterator[tuple[str, int, FloatArray, float]]
) -> list[Suspicion]:
    """Each suspect with the size that it may have.

    suspects : key of `CODES`, support, columns (groups, rows, m), and what a unit of them is.
    """
    parts, rows, found = of.parts, ROWS * len(of.fit.weight), []
    white = of.fit.white[:rows].reshape(groups, -1)
    left = parts.left[:rows].reshape(*white.shape, -1)
    for kind, support, columns, unit in suspects:
        theta, gain = best_variance(columns, white, left)
        if gain <= 0:
            continue
        size, p_value = float(np.sqrt(theta)), float(chi2_sf(gain, 1)) / 2  # θ at its bound else
        weight = gain - float(np.log(max(of.fit.rows, 2)))
        through = np.swapaxes(columns, 1, 2) @ left  # (groups, m, r)
        moved = parts.root @ through.reshape(-1, left.shape[2]).T
        move = size * np.linalg.norm(moved, axis=1)  # by independent units
        doubt = (kind, support, unit * size, move, p_value, weight)
        found.append(suspicion(of.fit.rig, of.uncertainty, *doubt))
    return found


def noise_columns(fit: Fit) -> Iterator[tuple[str, int, FloatArray]]:
    """Yield whitened columns (K, 6, m) of one unit of each suspect's standard deviation."""
    at, root, measured = fit.at, fit.root, fit.postures.measured[:, None, :]
    each = root[:, None] @ np.where(measured, at.noise_force, 0.0)  # (K, n, 6, 3), of one newton
    yield "hinge friction", 0, root[:, :, 3:]
    yield "hinge friction", 0, root[:, :, 3:5]  # of postures that tilt and do not twist
    for i in range(fit.rig.n):
        yield "sensor noise", i, each[:, i]
    yield "force noise", 0, np.moveaxis(each, 1, 2).reshape(len(root), ROWS, -1)
    stated = float(np.trace(fit.postures.position_cov, axis1=2, axis2=3).mean()) / 3
    if stated > 0:
        turn = covariance_root(at.turn_cov / stated)
        yield "position noise", 0, root @ at.noise_turn @ turn


def best_variance(columns: FloatArray, white: FloatArray, left: FloatArray) -> tuple[float, float]:
    """Variance θ ≥ 0 with the largest likelihood, and by how much it lowers −2 ln L.

    columns : (K, a, m), of groups whose noise is independent. white : (K, a). left : (K, a, r),
    orthonormal with the prior's rows: what the parameters do to the residuals.
    """
    values, vectors = np.linalg.eigh(np.swapaxes(columns, 1, 2) @ columns)
    heard = values > _ROUNDING * values.max(initial=0.0)  # what has no such variance stays
    unit = columns @ (vectors / np.sqrt(np.where(heard, values, np.inf))[:, None, :])
    unit, each = np.swapaxes(unit, 1, 2), values[heard]
    along, turned = (unit @ white[..., None])[heard][:, 0], (unit @ left)[heard]
    # Slope of the likelihood at 0, against its own scatter: most sensors ask for nothing.
    followed = np.sum(turned**2, axis=1)
    asked = float(each @ (along**2 + followed - 1.0))
    square = float(each**2 @ (1.0 - 2.0 * followed)) + float(
        np.sum(((turned.T * each) @ turned) ** 2)
    )
    if not len(each) or asked < _ASKED * np.sqrt(2.0 * max(square, 0.0)):
        return 0.0, 0.0
    from scipy.optimize import minimize_scalar  # slow to import, seldom needed

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

    tried = _TRIED - np.log(each.sum() / white.size)
    near, step = min(tried, key=cost), tried[1] - tried[0]
    best = minimize_scalar(
        cost, bounds=(near - step, near + step), method="bounded", options={"xatol": _FINE}
    )
    gain = float(along @ along) - float(best.fun)
    return (float(np.exp(best.x)), gain) if gain > 0 else (0.0, 0.0)


def _walks(fit: Fit, time: FloatArray) -> Iterator[tuple[str, int, FloatArray]]:
    """Whitened columns (1, 6 K, m) of the modes of walks of 1 N/√s."""
    n, K = fit.rig.n, len(fit.weight)
    modes, most = walk_modes(1.0, time)[0], _COLUMNS if K <= _MANY else _COLUMNS_OF_MANY
    modes = modes[:, np.argsort(-np.linalg.norm(modes, axis=0))[: max(1, most // (3 * n))]]
    by_zero = fit.slopes[:, :, layout(n, fit.state.motions)["zero"]]
    J = (by_zero * fit.rig.axes.ravel()).reshape(K, ROWS, n, 3)
    each = np.einsum("kaij,kg->ikagj", J, modes).reshape(n, 1, ROWS * K, -1)
    yield "all walk", 0, np.concatenate(each, axis=2)
    for i, columns in enumerate(each):
        yield "walk", i, columns
