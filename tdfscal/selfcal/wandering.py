"""Do zeros wander at random? A walk's noise goes together from posture to posture; white does not.

Walks with the intensity q add q² Z Zᵀ to the covariance of the whitened residuals r, Z their modes
(Karhunen–Loève) through the zeros' columns. Of Z and r only what no parameter follows is looked at
(REML, as in `scatter`): with the eigenvalues s and vectors v of Zᵀ Z and a = vᵀ Zᵀ r / √s,

    −2 ln L(q²) = Σ ln(1 + q² s) + a² / (1 + q² s),

so that the walk is held against white noise, slopes and jumps by likelihood.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.model.parameters import layout
from tdfscal.model.statics import features_jacobian
from tdfscal.model.zero_motion import walk_modes
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.scatter import Scatter, lowest

#: Columns that are looked at, of the slowest modes of all channels together: ten modes already
#: hold 96 % of a walk's variance.
_COLUMNS = 1200
_ROUNDING = 1e-9


def wanderings(
    fit: Fit, parts: Spectrum, root: FloatArray, residual: FloatArray, time: FloatArray
) -> list[Scatter]:
    """Walks of all zeros, and of each sensor's, the likeliest first; none where one is declared.

    root : (K, 6, 6), whitens a posture's residual; residual : (m,), whitened, postures first.
    time : (K,), s. The size of a walk is its intensity, N/√s.
    """
    motion = fit.postures.motion
    if motion is not None and "walk" in motion.kind:
        return []
    rows = 6 * len(root)
    left = parts.left[:rows]
    found = []
    for kind, support, columns in _columns(fit, root, time):
        through = left.T @ columns
        score = columns.T @ residual[:rows]
        variance, gain = _likeliest(columns.T @ columns - through.T @ through, score)
        size = float(np.sqrt(variance))
        effect = size * np.linalg.norm(parts.root @ through, axis=1)
        found.append(Scatter(kind, support, size, gain, effect))
    return sorted(found, key=lambda scatter: -scatter.gain)


def _columns(
    fit: Fit, root: FloatArray, time: FloatArray
) -> Iterator[tuple[str, int | None, FloatArray]]:
    """Whitened columns (6 K, m) of the modes of walks of 1 N/√s."""
    n, K = fit.rig.n, len(root)
    modes = walk_modes(1.0, time)[0]
    modes = modes[:, np.argsort(-np.linalg.norm(modes, axis=0))[: max(1, _COLUMNS // (3 * n))]]
    zero = layout(n, fit.state.motions)["zero"]
    by_zero = (fit.at.design @ features_jacobian(fit.state, fit.at, fit.rig.gravity))[:, :, zero]
    J = (root @ by_zero * fit.rig.axes.ravel()).reshape(K, 6, n, 3)
    each = [np.einsum("kaj,kg->kagj", J[:, :, i], modes).reshape(6 * K, -1) for i in range(n)]
    yield "all walk", None, np.concatenate(each, axis=1)
    for i, columns in enumerate(each):
        yield "walk", i, columns


def _likeliest(square: FloatArray, score: FloatArray) -> tuple[float, float]:
    """q² with the largest likelihood, and by how much it lowers −2 ln L; square (m, m)."""
    values, vectors = np.linalg.eigh(square)
    seen = values > _ROUNDING * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
    values = values[seen]
    if not len(values):
        return 0.0, 0.0
    along = (vectors[:, seen].T @ score) ** 2 / values

    def cost(logarithm: float) -> float:
        grown = 1.0 + np.exp(logarithm) * values
        return float(np.sum(np.log(grown) + along / grown))

    return lowest(cost, float(values.mean()), float(along.sum()))
