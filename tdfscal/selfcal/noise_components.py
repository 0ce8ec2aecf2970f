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

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.statics import Postures
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit
from tdfscal.significance import UNEQUAL_NOISE

#: Weight of the stated variance of a channel, in degrees of freedom.
_STATED = 4.0
_ROUNDS, _SETTLED = 60, 1e-3
#: A channel whose standard deviation exceeds the stated one by less is not named.
_NAMED = 1.3


@dataclass(frozen=True, slots=True)
class ChannelNoise:
    """Standard deviation of each channel's noise over the stated one, (n, 3), at least 1."""

    factor: FloatArray

    def worth(self, stated: Fit, own: Fit) -> float:
        """Fall of −2 ln L from a fit by the stated noise to one by this, less k ln N (Schwarz).

        Of all postures, also those that either leaves out: noise may have made them outliers.
        """

        def misfit(fit: Fit) -> float:
            spread = np.linalg.slogdet(fit.at.cov)[1]
            return float(np.sum(fit.distance + spread) + np.sum(fit.prior_residual**2))

        unknowns = int(np.sum(self.factor > 1.0))
        return misfit(stated) - misfit(own) - unknowns * float(np.log(max(stated.rows, 2)))

    def text(self, supports: tuple[str, ...]) -> str:
        """Name the channels that are noisier than stated."""
        named = [
            f"F{'xyz'[a]} of {supports[i]} {self.factor[i, a]:.2g} times"
            for i, a in np.argwhere(self.factor > _NAMED)
        ]
        return (
            "the residuals show more noise than is stated in some channels, and the postures were "
            f"weighted by it: {', '.join(named)}: look at these sensors and their cables"
        )


@dataclass(frozen=True, slots=True)
class _Model:
    """Residuals of the K used postures as e = J δ + noise.

    channel : (K, 6, 3n), columns of one stated standard deviation. rest : (K, 6, 6), covariance
    of all other noise. moment : (K, 6, 3), columns of a moment along each axis.
    """

    residual: FloatArray
    jacobian: FloatArray
    prior_residual: FloatArray
    prior_jacobian: FloatArray
    channel: FloatArray
    rest: FloatArray
    moment: FloatArray


def channel_noise(fit: Fit) -> ChannelNoise | None:
    """Noise of each channel where one scatters more than the others; else None.

    A scatter that moments explain better (friction of the hinges) is left to those who ask for it.
    """
    if not fit.postures.measured.all():
        return None
    model = _model(fit)
    theta = np.ones(model.channel.shape[2])
    birge2 = max(1.0, fit.cost / max(1, fit.dof))
    K, n = len(model.residual), fit.rig.n
    by_sensor = model.channel.reshape(K, 6, n, 3)
    p = np.concatenate(  # each channel, all of a sensor, the same axis of all sensors
        [
            _p_values(model, theta, group, birge2)
            for group in (model.channel[..., None], by_sensor, np.swapaxes(by_sensor, 2, 3))
        ]
    )
    friction = _p_values(model, theta, model.moment[:, :, None, :], birge2)[0]
    if p.min() * len(p) > UNEQUAL_NOISE or friction < p.min():
        return None
    factor = np.sqrt(np.maximum(_restricted(model, theta), 1.0))
    return ChannelNoise(factor.reshape(-1, 3))


def scaled(postures: Postures, noise: ChannelNoise) -> Postures:
    """Postures whose channels have this noise."""
    grown = noise.factor[:, :, None] * noise.factor[:, None, :]
    return replace(postures, force_cov=postures.force_cov * grown)


def _model(fit: Fit) -> _Model:
    used = fit.weight > 0
    at, seen = fit.at, fit.at.seen
    std = np.sqrt(np.diagonal(seen.force_cov[used], axis1=2, axis2=3))  # (K, n, 3)
    channel = at.noise_force[used] * std[:, :, None, :]  # (K, n, 6, 3)
    channel = np.moveaxis(channel, 1, 2).reshape(len(std), 6, -1)
    moment = np.zeros((len(std), 6, 3))
    moment[:, 3:] = np.eye(3)
    return _Model(
        residual=fit.residual[used],
        jacobian=fit.jacobian[used],
        prior_residual=fit.prior_residual,
        prior_jacobian=fit.prior_jacobian,
        channel=channel,
        rest=at.cov[used] - channel @ np.swapaxes(channel, 1, 2),
        moment=moment,
    )


def _projected(model: _Model, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """W (K, 6, 6), W r (K, 6) at the estimate by these variances, and W J root (K, 6, p)."""
    cov = model.rest + (model.channel * theta) @ np.swapaxes(model.channel, 1, 2)
    W = np.linalg.inv(cov)
    WJ = W @ model.jacobian
    P = model.prior_jacobian
    information = np.einsum("kap,kaq->pq", model.jacobian, WJ) + P.T @ P
    values, vectors = np.linalg.eigh(information)
    keep = values > values[-1] * len(values) * np.finfo(float).eps
    root = vectors[:, keep] / np.sqrt(values[keep])
    pull = np.einsum("kap,ka->p", WJ, model.residual) + P.T @ model.prior_residual
    rest = model.residual - model.jacobian @ (root @ (root.T @ pull))
    return np.asarray(W), np.asarray((W @ rest[..., None])[..., 0]), np.asarray(WJ @ root)


def _p_values(model: _Model, theta: FloatArray, columns: FloatArray, birge2: float) -> FloatArray:
    """Probability (c,) that noise alone scatters so much along columns (K, 6, c, m).

    The score is a sum of χ², held against the gamma distribution of its mean and variance
    (Satterthwaite, Biometrics 2, 1946), all noise scaled by the Birge ratio.
    """
    W, Wr, half = _projected(model, theta)
    found = []
    for c in range(columns.shape[2]):
        H = columns[:, :, c]  # (K, 6, m)
        score = float(np.sum(np.einsum("kam,ka->km", H, Wr) ** 2)) / birge2
        own = np.swapaxes(H, 1, 2) @ W @ H
        seen = np.einsum("kap,kam->pkm", half, H).reshape(half.shape[2], -1)
        known = seen @ seen.T
        mean = float(np.trace(own, axis1=1, axis2=2).sum() - np.trace(known))
        blocks = seen.reshape(len(seen), len(H), -1)
        overlap = float(np.einsum("kab,pka,pkb->", own, blocks, blocks, optimize=True))
        square = max(float(np.sum(own**2)) - 2 * overlap + float(np.sum(known**2)), 1e-300)
        found.append(float(chi2_sf(score * mean / square, mean**2 / square)))
    return np.array(found)


def _restricted(model: _Model, theta: FloatArray) -> FloatArray:
    """Variances (3n,) by restricted maximum likelihood, each shrunk towards 1."""
    for _ in range(_ROUNDS):
        W, Wr, half = _projected(model, theta)
        score = np.sum(np.einsum("kac,ka->kc", model.channel, Wr) ** 2, axis=0)
        mean = np.einsum("kac,kab,kbc->c", model.channel, W, model.channel, optimize=True)
        mean -= np.sum(np.einsum("kac,kap->ckp", model.channel, half) ** 2, axis=(1, 2))
        ratio = (score + _STATED / theta**2) / (np.maximum(mean, 0.0) + _STATED / theta)
        new: FloatArray = theta * np.sqrt(ratio)
        if np.max(np.abs(np.log(new / theta))) < _SETTLED:
            return new
        theta = new
    return theta
