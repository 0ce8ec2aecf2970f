"""Do the NCPs' coordinates close on a rigid terminal? The position equations (theory, section 2).

n hinges have 3n coordinates and a rigid terminal six degrees of freedom: 3n − 6 equations per
posture hold hinge distances against the hinge pattern, and no force enters them. What they show:

    p_ik − R_k r_i − T_k  =  datum_i + R_k δr_i + C F_ik + E_i (p_ik − p̄_i) + noise

seen across the rigid motions. Datum and hinge errors are constant and C is what gives under load
between encoder and hinge; E_i is an NCP whose frame is turned, scaled or not square. Not to be
told: a motion that all frames share, E along axes that the hinge pattern leaves free (with three
hinges, along the normal of their plane), and what the servo compels the terminal to follow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.pose import register
from tdfscal.model.statics import forces, wrench
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import Uncertainty
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.score_tests import largest_move
from tdfscal.selfcal.suspicion import Suspicion
from tdfscal.significance import CAUSES_APART, FRAME_MISFIT

#: Positions are not known better than this, m: rounding, and a terminal that bends.
_FLOOR = 2e-7
#: Ways in which a frame is wrong: words per component, with the entries (row, column) of E.
_WAYS: dict[str, dict[str, tuple[tuple[int, int, float], ...]]] = {
    "turned": {
        "about x": ((2, 1, 1.0), (1, 2, -1.0)),
        "about y": ((0, 2, 1.0), (2, 0, -1.0)),
        "about z": ((1, 0, 1.0), (0, 1, -1.0)),
    },
    "scaled": {
        "along x": ((0, 0, 1.0),),
        "along y": ((1, 1, 1.0),),
        "along z": ((2, 2, 1.0),),
    },
    "not square": {
        "y to z": ((2, 1, 1.0), (1, 2, 1.0)),
        "x to z": ((0, 2, 1.0), (2, 0, 1.0)),
        "x to y": ((1, 0, 1.0), (0, 1, 1.0)),
    },
}
_ROUNDING = 1e-10
#: Share of a component that must stand out of the nuisances to be seen.
_SEEN = 1e-6


@dataclass(frozen=True, slots=True)
class Closure:
    """Normal equations of the used postures' closure, in whitened units, all nuisances eliminated.

    whole : (n, 9, 9), of each frame by itself. information : (n, 9, 9), score : (n, 9), of each
    frame once the nuisances give way. chi2, dof : with the nuisances fitted.
    """

    whole: FloatArray
    information: FloatArray
    score: FloatArray
    chi2: float
    dof: int


def frame_errors(fit: Fit, parts: Spectrum, uncertainty: Uncertainty) -> tuple[Suspicion, ...]:
    """Name the NCP whose frame is turned, scaled or not square, if there is one."""
    n, closed = fit.rig.n, _closure(fit)
    if closed.dof <= 3:
        return ()
    tried = [_score(closed, i, way) for i in range(n) for way in _WAYS]
    best = max(tried, key=lambda score: score.gain)
    rest = max(1.0, (closed.chi2 - best.gain) / max(closed.dof - best.size, 1))
    p_value = float(chi2_sf(best.gain / rest, best.size)) if best.size else 1.0
    if p_value > FRAME_MISFIT / len(tried):
        return ()
    alike = [score for score in tried if (best.gain - score.gain) / rest < CAUSES_APART]
    used = fit.weight > 0
    away = fit.postures.position[:, best.frame]
    moved = (away - away[used].mean(axis=0)) @ best.error.T
    datum = 15 * n + 12 + 3 * best.frame
    columns = fit.at.design[:, :, datum : datum + 3] @ moved[..., None]
    return (
        largest_move(
            fit,
            parts,
            uncertainty,
            columns[..., 0],
            what=_named(fit.rig.supports, best, alike, rest),
            advice="align it, or calibrate the positioner; hinge distances show no error that all "
            "positioners share",
            p_value=min(1.0, len(tried) * p_value),
        ),
    )


def _closure(fit: Fit) -> Closure:
    """Fit the closure's nuisances: datums, hinges, compliance."""
    used, n = fit.weight > 0, fit.rig.n
    p = fit.postures.position[used] - fit.state.datum
    R, T = register(fit.state.hinge, p)
    arm = np.einsum("kab,nb->kna", R, fit.state.hinge)
    off = (p - arm - T[:, None]).reshape(len(p), -1)
    rigid = _orthonormal(np.swapaxes(wrench(arm - arm.mean(axis=1, keepdims=True)), 2, 3), n)

    F = forces(fit.state, fit.postures.force[used])
    variance = np.trace(fit.postures.position_cov[used], axis1=2, axis2=3).mean(axis=1) / 3
    scale = 1 / np.sqrt(variance + _FLOOR**2)
    away = p - p.mean(axis=0)
    K, eye = len(p), np.eye(3)
    nuisances = np.zeros((K, n, 3, 6 * n + 2))
    for i in range(n):
        nuisances[:, i, :, 3 * i : 3 * i + 3] = eye
        nuisances[:, i, :, 3 * (n + i) : 3 * (n + i) + 3] = R
    nuisances[:, :, :2, 6 * n] = F[..., :2]
    nuisances[:, :, 2, 6 * n + 1] = F[..., 2]

    def white(columns: FloatArray) -> FloatArray:
        """Rows (3nK, c) of columns (K, 3n, c) across the rigid motions."""
        across = columns - rigid @ (np.swapaxes(rigid, 1, 2) @ columns)
        return np.asarray((across * scale[:, None, None]).reshape(3 * n * K, -1))

    rows = white(nuisances.reshape(K, 3 * n, -1))
    normal, right = rows.T @ rows, rows.T @ (off := (off * scale[:, None]).ravel())
    hinge = fit.rig.declared.hinge
    if hinge > 0:  # else a hinge's error cannot be told from a datum's
        place = np.arange(3 * n, 6 * n)
        normal[place, place] += hinge**-2
    inverse, rank = _inverse(normal)
    whole, information, score = np.empty((n, 9, 9)), np.empty((n, 9, 9)), np.empty((n, 9))
    for i in range(n):
        frame = np.zeros((K, n, 3, 9))
        frame[:, i] = np.einsum("ab,kc->kabc", eye, away[:, i]).reshape(K, 3, 9)
        own = white(frame.reshape(K, 3 * n, 9))
        cross, whole[i] = rows.T @ own, own.T @ own
        information[i] = whole[i] - cross.T @ inverse @ cross
        score[i] = own.T @ off - cross.T @ (inverse @ right)
    chi2 = float(off @ off - right @ inverse @ right)
    dof = K * (3 * n - 6) - rank + (3 * n if hinge > 0 else 0)
    return Closure(whole, information, score, chi2, dof)


def _orthonormal(blocks: FloatArray, n: int) -> FloatArray:
    """Orthonormal basis (K, 3n, 6) of the rigid motions, of blocks (K, n, 3, 6)."""
    return np.linalg.qr(blocks.reshape(len(blocks), 3 * n, 6))[0]


def _inverse(normal: FloatArray) -> tuple[FloatArray, int]:
    """Pseudo-inverse of normal equations, and their rank."""
    size = np.sqrt(np.diagonal(normal))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    keep = values > _ROUNDING * max(values.max(initial=0.0), 1e-300)
    half = vectors[:, keep] / np.sqrt(values[keep]) / size[:, None]
    return half @ half.T, int(keep.sum())


@dataclass(frozen=True, slots=True)
class _Score:
    """What one way of being wrong explains: fall of χ² with `size` unknowns.

    value, std : (3,), the components; std ∞ where closure does not see one. error : (3, 3), E.
    """

    frame: int
    way: str
    gain: float
    size: int
    value: FloatArray
    std: FloatArray
    error: FloatArray


def _score(closed: Closure, frame: int, way: str) -> _Score:
    """Free the three components of one way of one frame, all nuisances given way."""
    basis = np.zeros((9, 3))
    for column, entries in enumerate(_WAYS[way].values()):
        for a, b, weight in entries:
            basis[3 * a + b, column] = weight
    whole = basis.T @ closed.whole[frame] @ basis
    information = basis.T @ closed.information[frame] @ basis
    score = basis.T @ closed.score[frame]
    values, vectors = np.linalg.eigh(information)
    seen = values > _SEEN * max(float(np.trace(whole)), 1e-300)
    half = vectors[:, seen] / np.sqrt(values[seen])
    value = half @ (half.T @ score)
    blind = np.abs(vectors[:, ~seen]).max(axis=1, initial=0.0) > _SEEN
    return _Score(
        frame=frame,
        way=way,
        gain=float(np.sum((half.T @ score) ** 2)),
        size=int(seen.sum()),
        value=value,
        std=np.where(blind, np.inf, np.linalg.norm(half, axis=1)),
        error=(basis @ value).reshape(3, 3),
    )


def _named(supports: tuple[str, ...], best: _Score, alike: list[_Score], scale: float) -> str:
    """Whose frame is wrong, how, by how much, and what looks the same."""
    parts = [
        f"{words} by {1e3 * value:.2g} ± {1e3 * std * np.sqrt(scale):.1g} mrad"
        for words, value, std in zip(_WAYS[best.way], best.value, best.std, strict=True)
        if np.isfinite(std)
    ]
    others = [
        f"{other.way} {supports[other.frame]}"
        for other in alike
        if (other.frame, other.way) != (best.frame, best.way)
    ]
    text = f"the frame of the positioner of {supports[best.frame]} is {best.way}"
    if parts:
        text += f" ({', '.join(parts)})"
    if others:
        text += f"; not told apart from {', '.join(others)}"
    return text
