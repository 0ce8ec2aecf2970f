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

from tdfscal.model.parameters import layout
from tdfscal.model.pose import register
from tdfscal.model.statics import forces, wrench
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import spectrum, triangular
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import Estimate
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.score_tests import Asked, ask
from tdfscal.selfcal.suspicion import Suspicion, worst_angle
from tdfscal.significance import CAUSES_APART, FRAME_MISFIT

#: Positions are not known better than this, m: rounding, and a terminal that bends.
_FLOOR = 2e-7
#: Ways in which a frame is wrong: its three components in words, with E of each by one, (3, 3, 3).
_WAYS: dict[str, tuple[tuple[str, str, str], FloatArray]] = {
    "turned": (("about x", "about y", "about z"), so3.hat(np.eye(3))),
    "scaled": (("along x", "along y", "along z"), np.eye(3)[:, :, None] * np.eye(3)[:, None]),
    "not square": (("y to z", "x to z", "x to y"), np.abs(so3.hat(np.eye(3)))),
}
#: Share of a component that must stand out of the nuisances to be seen.
_SEEN = 1e-6


@dataclass(frozen=True, slots=True)
class _Tried:
    """One way of being wrong, `asked` by how much. error : (3, 3), E."""

    frame: int
    way: str
    asked: Asked
    error: FloatArray


def frame_errors(of: Estimate) -> tuple[Suspicion, ...]:
    """Name the NCP whose frame is turned, scaled or not square, if there is one."""
    fit = of.fit
    dof, chi2, tried = _tried(fit)
    if dof <= 3:
        return ()
    best = max(tried, key=lambda each: each.asked.statistic)
    gain, size = best.asked.statistic, best.asked.unknowns
    rest = max(1.0, (chi2 - gain) / max(dof - size, 1))
    p_value = float(chi2_sf(gain / rest, size)) if size else 1.0
    if p_value > FRAME_MISFIT / len(tried):
        return ()
    alike = [each for each in tried if (gain - each.asked.statistic) / rest < CAUSES_APART]
    away = fit.postures.position[:, best.frame]
    moved = (away - away[fit.weight > 0].mean(axis=0)) @ best.error.T
    datum = layout(fit.rig.n, fit.state.motions)["datum"].start + 3 * best.frame
    white = (fit.slopes[:, :, datum : datum + 3] @ moved[..., None]).ravel()
    # The angles give way to what the wrong frame adds to the balance.
    move = of.parts.root @ (of.parts.left[: len(white)].T @ white)
    return (
        Suspicion(
            _named(fit.rig.supports, best, alike, rest),
            "align it, or calibrate the positioner; hinge distances show no error that all "
            "positioners share",
            min(1.0, len(tried) * p_value),
            *worst_angle(fit.rig, of.uncertainty, move),
        ),
    )


def _tried(fit: Fit) -> tuple[int, float, list[_Tried]]:
    """Degrees of freedom and χ² of the closure of the used postures, and every way of every frame.

    All that is no frame's error is fitted beside: datums, hinges, compliance.
    """
    used, n = fit.weight > 0, fit.rig.n
    p = fit.postures.position[used] - fit.state.datum
    R, T = register(fit.state.hinge, p)
    arm = np.einsum("kab,nb->kna", R, fit.state.hinge)
    spokes = np.swapaxes(wrench(arm - arm.mean(axis=1, keepdims=True)), 2, 3)
    K, eye = len(p), np.eye(3)
    rigid = np.linalg.qr(spokes.reshape(K, 3 * n, 6))[0]
    variance = np.trace(fit.postures.position_cov[used], axis1=2, axis2=3).mean(axis=1) / 3
    scale = 1 / np.sqrt(variance + _FLOOR**2)

    def white(columns: FloatArray) -> FloatArray:
        """Rows (3nK, c) of columns (K, n, 3, c), in whitened units across the rigid motions."""
        flat = columns.reshape(K, 3 * n, -1)
        across = flat - rigid @ (np.swapaxes(rigid, 1, 2) @ flat)
        return np.asarray((across * scale[:, None, None]).reshape(3 * n * K, -1))

    F = forces(fit.state, fit.postures.force[used])
    nuisances = np.zeros((K, n, 3, 6 * n + 2))
    for i in range(n):
        nuisances[:, i, :, 3 * i : 3 * i + 3] = eye
        nuisances[:, i, :, 3 * (n + i) : 3 * (n + i) + 3] = R
    nuisances[:, :, :2, 6 * n] = F[..., :2]
    nuisances[:, :, 2, 6 * n + 1] = F[..., 2]
    # Where hinges are exact a hinge's error cannot be told from a datum's.
    hinge = fit.rig.declared.hinge
    prior = np.eye(3 * n, 6 * n + 2, 3 * n) / hinge if hinge > 0 else np.zeros((0, 6 * n + 2))
    below = np.zeros((len(prior), 9))
    rows = np.concatenate([white(nuisances), prior])
    del nuisances  # in long campaigns as large as all that follows
    left = rows @ spectrum(triangular(rows), len(rows)).root
    off = np.concatenate([white((p - arm - T[:, None])[..., None])[:, 0], below[:, 0]])
    off -= left @ (left.T @ off)
    tried, away = [], p - p.mean(axis=0)
    every = np.concatenate([errors for _, errors in _WAYS.values()])
    for i in range(n):
        frame = np.zeros((K, n, 3, 9))
        frame[:, i] = np.einsum("cab,kb->kac", every, away[:, i])
        columns = np.concatenate([white(frame), below])
        apart = columns - left @ (left.T @ columns)
        for first, (way, (_, errors)) in zip((0, 3, 6), _WAYS.items(), strict=True):
            own = slice(first, first + 3)
            asked = ask(apart[:, own], columns[:, own], -off, seen_from=_SEEN)
            tried.append(_Tried(i, way, asked, np.tensordot(asked.amount, errors, axes=1)))
    dof = K * (3 * n - 6) + len(prior) - left.shape[1]
    return dof, float(off @ off), tried


def _named(supports: tuple[str, ...], best: _Tried, alike: list[_Tried], scale: float) -> str:
    """Whose frame is wrong, how, by how much, and what looks the same."""
    parts = [
        f"{words} by {1e3 * value:.2g} ± {1e3 * std * np.sqrt(scale):.1g} mrad"
        for words, value, std in zip(
            _WAYS[best.way][0], best.asked.amount, best.asked.std, strict=True
        )
        if np.isfinite(std)
    ]
    others = [f"{other.way} {supports[other.frame]}" for other in alike if other is not best]
    text = f"the frame of the positioner of {supports[best.frame]} is {best.way}"
    if parts:
        text += f" ({', '.join(parts)})"
    if others:
        text += f"; not told apart from {', '.join(others)}"
    return text
