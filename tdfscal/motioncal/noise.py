"""Spectrum of the residual wrench: two smooth curves, by restricted Whittle likelihood.

S(f) = S_F(f) K_F + S_P(f) K_P: force noise, alike on all sensors, through its lever arms, and the
moment of a wrongly registered pose from errors of the servo positions. log S_F and log S_P are
piecewise linear in log f under a prior of smoothness. In the common eigenvectors of K_F and K_P
the six components are independent, with variances S_F(f) + λ S_P(f).

The fit takes power away where it has most freedom, in the lowest bins. What it takes is J C Jᴴ;
added back to the residual's power it makes the likelihood the restricted one (Patterson and
Thompson, Biometrika 58, 1971), whose curves are not too low.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, FloatArray, IntArray

#: Ratio of neighbouring knots.
_KNOT_RATIO = 2.5
#: Standard deviation of a curve's second difference from knot to knot.
_BEND = 1.0
#: Prior of the force noise's level: hardly any.
_LEVEL = 20.0
#: Prior of the position noise's level, a factor of ten either way, about the stated one.
_POSITION_LEVEL = 2.3
#: Positioners of which nothing is stated, m.
UNSTATED = 3.0e-6
#: The positioners' errors change over their travel: power up to this frequency, Hz.
_POSITION_CORNER = 0.2
#: Largest change of a curve's logarithm in one step.
_STEP = 1.5


@record
class Bins:
    """What the curves are estimated from: M rows, one per Fourier coefficient and component.

    frequency : (M,), Hz. ratio : (M,), λ, N²/m². count : (M,), independent real values that the
    row stands for.
    """

    frequency: FloatArray
    ratio: FloatArray
    count: FloatArray

    def some(self, which: BoolArray | IntArray) -> Bins:
        """Some of the rows."""
        return Bins(self.frequency[which], self.ratio[which], self.count[which])

    @classmethod
    def stacked(cls, parts: Sequence[Bins]) -> Bins:
        """Rows of all parts."""
        return cls(
            np.concatenate([part.frequency for part in parts]),
            np.concatenate([part.ratio for part in parts]),
            np.concatenate([part.count for part in parts]),
        )


@record
class NoiseModel:
    """The two curves.

    knot : (H,), log of Hz. log_density : (2H,), of S_F (N²/Hz) and S_P (m²/Hz), two-sided.
    mean, precision : their prior. covariance : (2H, 2H), of log_density.
    """

    knot: FloatArray
    log_density: FloatArray
    mean: FloatArray
    precision: FloatArray
    covariance: FloatArray

    def basis(self, frequency: FloatArray) -> FloatArray:
        """Weights (M, H) of the knots at frequencies (M,), Hz."""
        at, rows = np.log(np.maximum(frequency, np.exp(self.knot[0]))), np.arange(len(frequency))
        k = np.clip(np.searchsorted(self.knot, at) - 1, 0, len(self.knot) - 2)
        share = np.minimum((at - self.knot[k]) / (self.knot[k + 1] - self.knot[k]), 1.0)
        out = np.zeros((len(frequency), len(self.knot)))
        out[rows, k], out[rows, k + 1] = 1 - share, share
        return out

    def variance(self, bins: Bins, log_density: FloatArray | None = None) -> FloatArray:
        """Variance (M,) of every row."""
        force, place = self.parts(bins, log_density)
        return np.asarray(force + place)

    def parts(
        self, bins: Bins, log_density: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Parts (M,) of the variance: of the forces, of the poses."""
        force, place = self.density(bins.frequency, log_density)
        return force, bins.ratio * place

    def density(
        self, frequency: FloatArray, log_density: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """S_F (N²/Hz) and S_P (m²/Hz) at frequencies (M,)."""
        value = self.log_density if log_density is None else log_density
        force, place = np.split(value, 2)
        h = self.basis(frequency)
        return np.exp(h @ force), np.exp(h @ place)


#: Before a first look.
NOTHING = NoiseModel(*(np.zeros(0),) * 5)


def initial(bins: Bins, power: FloatArray, positioner: float, longest: float) -> NoiseModel:
    """Start from flat force noise; power (M,) of the residual, positioner in m, longest in s."""
    low, high = float(np.log(0.7 / longest)), float(np.log(bins.frequency.max()))
    H = max(3, 1 + int(np.ceil((high - low) / np.log(_KNOT_RATIO))))
    knot = np.asarray(np.linspace(low, high, H), dtype=np.float64)
    flat = bins.ratio <= np.median(bins.ratio)
    # Rows of one band share its power among them as they please.
    _, band = np.unique(bins.frequency[flat] + 1j * bins.ratio[flat], return_inverse=True)
    mean = np.bincount(band, (power * bins.count)[flat]) / np.bincount(band, bins.count[flat])
    level = np.log(np.median(mean) / np.log(2) + 1e-12)
    std = max(positioner, UNSTATED)
    f = np.exp(knot)
    log_place = np.log(std**2 / (2 * _POSITION_CORNER)) - np.log1p((f / _POSITION_CORNER) ** 4)
    bend = np.diff(np.eye(H), 2, axis=0)
    smooth = bend.T @ bend / _BEND**2
    precision = np.zeros((2 * H, 2 * H))
    precision[:H, :H] = smooth + np.eye(H) / _LEVEL**2
    precision[H:, H:] = smooth + np.eye(H) / _POSITION_LEVEL**2
    mean = np.concatenate([np.full(H, level), log_place])
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    return NoiseModel(knot, mean, mean, precision, covariance)


def improve(
    model: NoiseModel, bins: Bins, power: FloatArray, leverage: FloatArray
) -> tuple[NoiseModel, float]:
    """One step of Fisher scoring.

    power : (M,), |residual|² plus the fitted part J C Jᴴ. leverage : (M,), share of the row that
    the fit uses up. Returns the model with its covariance, and the largest change of a logarithm.
    """
    force, place = model.parts(bins)
    variance = force + place
    h = model.basis(bins.frequency)
    slope = np.concatenate(
        [h * (force / variance)[:, None], h * (place / variance)[:, None]], axis=1
    )
    half = 0.5 * bins.count
    gradient = slope.T @ (half * (power / variance - 1))
    gradient -= model.precision @ (model.log_density - model.mean)
    weight = half * np.clip(1 - leverage, 0.0, 1.0) ** 2
    information = (slope * weight[:, None]).T @ slope + model.precision
    step = np.linalg.solve(information, gradient)
    largest = float(np.abs(step).max())
    step *= min(1.0, _STEP / max(largest, 1e-300))
    return (
        replace(
            model,
            log_density=model.log_density + step,
            covariance=np.linalg.inv(information),
        ),
        largest,
    )
