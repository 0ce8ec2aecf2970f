"""Sensors whose noise is not what is stated: a variance for each channel, from the residuals.

One scale for all noise (the Birge ratio) makes a quiet sensor pay for a noisy one. Where a channel
scatters more than the others do, by a test with a stated rate of false alarms, each channel's
variance is estimated by restricted maximum likelihood, shrunk towards what is stated, and the
postures are weighted by it.

References
----------
Zhou, Hu, Qiao, Cho, Zhou: MM algorithms for variance components models. J. Comput. Graph. Stat. 28
(2019) 350–361.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.estimation.uncertainty import Estimate
from tdfscal.findings import Finding, Value
from tdfscal.model.statics import Postures
from tdfscal.numerics.distributions import chi2_quantile, chi2_sf
from tdfscal.records import FloatArray, IntArray
from tdfscal.selfcal.estimator import ROWS, Fit, estimate, fit
from tdfscal.selfcal.score_tests import best_variance, by_readings, chance, noise_columns
from tdfscal.significance import (
    CAUSES_APART,
    GROSS_NOISE_FACTOR,
    GROSS_NOISE_SHARE,
    OUTLYING_POSTURE,
    OVERSTATED_NOISE,
    UNEQUAL_NOISE,
)

#: Weight of the stated variance of a channel, in degrees of freedom.
_STATED = 4.0
_ROUNDS, _SETTLED = 60, 1e-3
#: Halvings of a share of a variance: beyond the two digits that are said.
_HALVINGS = 20
#: Share of a variance below which there is none.
_ROUNDING = 1e-12
#: A channel whose standard deviation exceeds the stated one by less is not named.
_NAMED = 1.3
#: Postures that are listed at most.
_LISTED = 8


def gross_noise(
    factor: FloatArray, weighted: Fit, stated: Postures, number: IntArray
) -> Finding | None:
    """The worst channel whose noise no working one has; None where there is none.

    factor : (n, 3), noise over the stated one. weighted : the fit by it. stated, number : (K,), its
    postures as stated, and by which they go.
    """
    rig = weighted.rig
    std = np.sqrt(np.median(np.diagonal(stated.force_cov, axis1=2, axis2=3), axis=0))
    load = np.median(np.linalg.norm(stated.force - weighted.state.zero, axis=2), axis=0)
    noise = factor * std
    gross = (factor > GROSS_NOISE_FACTOR) & (noise > GROSS_NOISE_SHARE * load[:, None])
    if not gross.any():
        return None
    known = estimate(fit(rig, stated, weighted.state, weighted.weight))
    left = known.parts.left[: ROWS * len(stated)].reshape(len(stated), ROWS, -1)
    white = known.fit.white[: ROWS * len(stated)].reshape(-1, ROWS)
    gain = np.array(
        [
            [best_variance(sensor[..., [a]], white, left)[1] for a in range(3)]
            for sensor in np.moveaxis(by_readings(known.fit), 1, 0)
        ]
    )
    i, a = np.unravel_index(int(np.argmax(np.where(gross, gain, -1.0))), gross.shape)
    limit = chi2_quantile(1 - OUTLYING_POSTURE / len(stated), ROWS)
    near = [
        f"F{'xyz'[c]} of {rig.supports[j]}"
        for j, c in np.argwhere(gain > gain[i, a] - CAUSES_APART)
        if (j, c) != (i, a)
    ]
    out = number[known.fit.distance > limit]
    values: dict[str, Value] = {
        "channel": f"F{'xyz'[a]} of {rig.supports[i]}",
        "factor": float(factor[i, a]),
        "share": float(noise[i, a] / load[i]),
        "postures": [str(k) for k in out[:_LISTED]],
        "more": len(out) > _LISTED,
        "alike": near,
    }
    subject, size = (rig.supports[i],), float(noise[i, a])
    return Finding("channel-broken", subject, size, "N", values=values, rejects=True)


def channel_noise(of: Estimate[Fit]) -> FloatArray | None:
    """Noise of each channel over the stated one, (n, 3), at least 1; None where it is alike in all.

    A scatter that moments explain better (friction of the hinges) is left to those who ask for it.
    """
    fit, parts = of.fit, of.parts
    if not fit.postures.measured.all():
        return None
    std = np.sqrt(np.diagonal(fit.postures.force_cov, axis1=2, axis2=3))  # (K, n, 3)
    by_sensor = np.moveaxis(by_readings(fit) * std[:, :, None, :], 1, 2)  # (K, 6, n, 3)
    channel = by_sensor.reshape(*by_sensor.shape[:2], -1)
    groups = [channel[:, :, [c]] for c in range(channel.shape[2])]
    groups += [by_sensor[:, :, i] for i in range(fit.rig.n)]
    groups += [by_sensor[..., a] for a in range(3)]
    usual = fit.white / np.sqrt(max(1.0, fit.cost / max(1, fit.dof)))  # by the Birge ratio
    p = [chance(columns, parts, usual) for columns in groups]
    if min(p) * len(p) > UNEQUAL_NOISE or chance(fit.root[:, :, 3:], parts, usual) < min(p):
        return None
    theta = _restricted(channel, parts.left, fit.white)
    return np.sqrt(np.maximum(theta, 1.0)).reshape(-1, 3)


def scaled(postures: Postures, factor: FloatArray) -> Postures:
    """Postures whose channels have this noise over the stated one, (n, 3)."""
    grown = factor[:, :, None] * factor[:, None, :]
    return replace(postures, force_cov=postures.force_cov * grown)


def noisier(factor: FloatArray, supports: tuple[str, ...]) -> Finding:
    """Name the channels that are noisier than stated."""
    named = np.argwhere(factor > _NAMED)
    channels = [f"F{'xyz'[a]} of {supports[i]} {factor[i, a]:.2g} times" for i, a in named]
    subject = tuple(dict.fromkeys(supports[i] for i, _ in named))
    values: dict[str, Value] = {"channels": channels}
    return Finding("channels-noisy", subject, float(factor.max()), values=values)


def supported(of: Estimate[Fit]) -> dict[str, float]:
    """Noise, as `DeclaredUncertainty` has it, by which residuals smaller than stated are as large
    as they should be.

    Of the forces or of the positioners, the likelier, all else being right; 0 where none of it
    leaves them not improbably small, empty where even that does not help.
    """
    fit, (chi2, dof) = of.fit, (of.quality.chi2, of.fit.dof)
    white = fit.white[: ROWS * len(fit.weight)].reshape(-1, ROWS)
    keys, found = {"force noise": "force_noise", "position noise": "positioner"}, []
    for kind, _, columns in noise_columns(fit):
        stated = float(getattr(fit.rig.declared, keys[kind])) if kind in keys else 0.0
        values, vectors = np.linalg.eigh(columns @ np.swapaxes(columns, 1, 2))
        lost = np.minimum(stated**2 * values, 1.0 - _ROUNDING)
        along, low, high = np.einsum("kab,ka->kb", vectors, white) ** 2, 0.0, 1.0
        if 1.0 - chi2_sf(chi2 + np.sum(along * lost / (1.0 - lost)), dof) <= OVERSTATED_NOISE:
            continue
        for _ in range(_HALVINGS):  # of the share of the variance that is too much
            share = (low + high) / 2
            more = along * share * lost / (1.0 - share * lost)
            low, high = (low, share) if chi2 + np.sum(more) > dof else (share, high)
        size = float(f"{stated * np.sqrt(1.0 - high):.1e}")
        found.append((float(np.sum(more + np.log1p(-share * lost))), keys[kind], size))
    return dict([min(found)[1:]]) if found else {}


def _restricted(channel: FloatArray, left: FloatArray, white: FloatArray) -> FloatArray:
    """Variances (3n,) by restricted maximum likelihood, each shrunk towards 1.

    channel : (K, 6, 3n), whitened columns of one stated standard deviation. left : (m, r), what the
    parameters do to the whitened residual white (m,), orthonormal; postures first, then priors.
    """
    K, rows = len(channel), channel.shape[1] * len(channel)
    J, e = left[:rows].reshape(K, ROWS, -1), white[:rows].reshape(K, ROWS)
    prior = left[rows:].T @ left[rows:]
    prior_pull = left[rows:].T @ white[rows:]
    theta, across = np.ones(channel.shape[2]), np.swapaxes(channel, 1, 2)
    for _ in range(_ROUNDS):
        W = np.linalg.inv(np.eye(ROWS) + (channel * (theta - 1.0)) @ across)
        WJ = (W @ J).reshape(rows, -1)
        root = np.linalg.inv(np.linalg.cholesky(left[:rows].T @ WJ + prior))
        pull = root.T @ (root @ (WJ.T @ white[:rows] + prior_pull))
        rest = W @ (e - (left[:rows] @ pull).reshape(e.shape))[..., None]
        score = np.sum((across @ rest) ** 2, axis=(0, 2))
        taken = (WJ @ root.T).reshape(J.shape)  # by the parameters
        kept = W - taken @ np.swapaxes(taken, 1, 2)
        mean = np.sum(channel * (kept @ channel), axis=(0, 1))
        ratio = (score + _STATED / theta**2) / (np.maximum(mean, 0.0) + _STATED / theta)
        new: FloatArray = theta * np.sqrt(ratio)
        if np.max(np.abs(np.log(new / theta))) < _SETTLED:
            return new
        theta = new
    return theta
