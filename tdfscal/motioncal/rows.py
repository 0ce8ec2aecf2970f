"""Fourier coefficients as rows of independent noise, of bounded number, and their noise's spectrum.

The residual wrench has two smooth curves, by restricted Whittle likelihood: S(f) = S_F(f) K_F +
S_P(f) K_P, force noise, alike on all sensors, through its lever arms, and the moment of a wrongly
registered pose from errors of the servo positions. log S_F and log S_P are piecewise linear in
log f under a prior of smoothness. In the common eigenvectors of K_F and K_P the components of a
block's wrench (six where every axis is measured) are independent, with variances S_F(f) + λ S_P(f).

The fit takes power away where it has most freedom, in the lowest bins. What it takes is J C Jᴴ;
added back to the residual's power it makes the likelihood the restricted one (Patterson and
Thompson, Biometrika 58, 1971), whose curves are not too low.

Rows of one component and of neighbouring frequencies, which a long log has many of, are brought to
one scale by the spectrum as it was last seen and stand as one triangular factor with a common
variance: a statistic whose size no log's length changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.motioncal.blocks import Block
from tdfscal.numerics.least_squares import gram_root, triangular
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

    @classmethod
    def of(cls, block: Block, ratio: FloatArray) -> Bins:
        """Real and imaginary parts of a block's coefficients, of r components; ratio : (r,)."""
        f = block.frequency.copy()
        f[0] = 0.5 * f[1]  # what the mean sees
        both, r = np.concatenate([f, f[1:]]), len(ratio)
        each = np.repeat(both, r), np.tile(ratio, len(both))
        return cls(*each, np.full(r * len(both), block.share))

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

    def variance(self, bins: Bins) -> FloatArray:
        """Variance (M,) of every row."""
        force, place = self.parts(bins)
        return np.asarray(force + place)

    def parts(self, bins: Bins) -> tuple[FloatArray, FloatArray]:
        """Parts (M,) of the variance: of the forces, of the poses."""
        force, place = self.density(bins.frequency)
        return force, bins.ratio * place

    def slope(self, bins: Bins) -> FloatArray:
        """Derivative (M, 2H) of the logarithm of every row's variance by log_density."""
        h, parts = self.basis(bins.frequency), self.parts(bins)
        share = np.stack(parts) / np.sum(parts, axis=0)
        return np.concatenate([h * own[:, None] for own in share], axis=1)

    def density(self, frequency: FloatArray) -> tuple[FloatArray, FloatArray]:
        """S_F (N²/Hz) and S_P (m²/Hz) at frequencies (M,)."""
        force, place = np.split(self.log_density, 2)
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
    slope, weight = model.slope(bins), _weight(bins, leverage)
    gradient = slope.T @ (0.5 * bins.count * (power / model.variance(bins) - 1))
    gradient -= model.precision @ (model.log_density - model.mean)
    information = (slope * weight[:, None]).T @ slope + model.precision
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    step = covariance @ gradient
    largest = float(np.abs(step).max())
    step *= min(1.0, _STEP / max(largest, 1e-300))
    return replace(model, log_density=model.log_density + step, covariance=covariance), largest


def at_mean(model: NoiseModel, bins: Bins, leverage: FloatArray) -> NoiseModel:
    """The curves at the mean of their logarithms, from those at the mode.

    Few values leave a variance skewed: C T / 2, T the third derivatives of the likelihood along C
    (Lindley, Trabajos de Estadística 31, 1980). Of log v along the curves these are
    n (g'³ − 3 g' g'') / 2.
    """
    slope, C = model.slope(bins), model.covariance
    h, H, both = model.basis(bins.frequency), len(model.knot), np.split(slope, 2, axis=1)
    share = np.stack([own.sum(axis=1) for own in both])
    along = np.stack([np.sum(h * own, axis=1) for own in np.split(slope @ C, 2, axis=1)])
    each = np.stack([np.sum(h @ own * h, axis=1) for own in (C[:H, :H], C[H:, H:])])
    bent = 4 * np.sum(share * along, axis=0) - np.sum(share * each, axis=0) - 2 * along
    weighted = _weight(bins, leverage) * bent
    third = np.concatenate([own.T @ row for own, row in zip(both, weighted, strict=True)])
    return replace(model, log_density=model.log_density + 0.5 * C @ third)


def _weight(bins: Bins, leverage: FloatArray) -> FloatArray:
    """Information (M,) of every row about the logarithm of its variance."""
    return np.asarray(0.5 * bins.count * np.clip(1 - leverage, 0.0, 1.0) ** 2)


#: Ratio of the frequencies of neighbouring bands.
_BAND = 1.2
#: Rows of one band that are gathered before they are factored.
_GATHERED = 512


@record
class Rows:
    """All blocks in their independent components: design (M, q + 13 + s + all rests), real.

    bins : their M frequencies and weights.
    """

    design: FloatArray
    bins: Bins

    def weighted(self, columns: FloatArray, variance: FloatArray) -> FloatArray:
        """Columns (M, …) of these rows, white where every row has its variance (M,)."""
        factor = np.sqrt(self.bins.count / variance)
        return np.asarray(columns * factor.reshape(-1, *(1,) * (columns.ndim - 1)))

    @classmethod
    def stacked(cls, parts: Sequence[Rows]) -> Rows:
        """Rows of all parts."""
        design = np.concatenate([part.design for part in parts])
        return cls(design, Bins.stacked([part.bins for part in parts]))


def gather(parts: Iterable[tuple[Rows, int]], low: float, model: NoiseModel | None) -> Rows:
    """Rows of all blocks, joined where they are more than columns.

    parts : of each block, with the number of its components, which stand in turn. low : lower edge
    of the first band, Hz. model : the spectrum as last seen, by which the rows of a band are
    brought to one scale.
    """
    bands: dict[int, list[Rows]] = {}

    def join_if_more(number: int, most: int) -> None:
        if sum(len(part.design) for part in bands[number]) > most:
            bands[number] = [_joined(bands[number], model)]

    for part, r in parts:
        band = np.floor(np.log(part.bins.frequency / low) / np.log(_BAND) + 1e-9).astype(int)
        numbers = r * band + np.arange(len(band)) % r
        columns = part.design.shape[1]
        for number in np.unique(numbers).tolist():
            own = numbers == number
            rows = Rows(part.design[own], part.bins.some(own))
            bands.setdefault(number, []).append(rows)
            join_if_more(number, max(_GATHERED, 2 * columns))
    for number in bands:
        join_if_more(number, columns)
    return Rows.stacked([part for _, own in sorted(bands.items()) for part in own])


def _joined(parts: Sequence[Rows], model: NoiseModel | None) -> Rows:
    """Rows of one band and one component as one triangular factor of a common variance."""

    def variance(bins: Bins) -> FloatArray:
        return np.ones(len(bins.count)) if model is None else model.variance(bins)

    whole = Rows.stacked(parts)
    bins, factor = whole.bins, triangular(whole.weighted(whole.design, variance(whole.bins)))
    each = np.stack([np.ones(len(bins.count)), np.log(bins.frequency), bins.ratio])
    count, log_frequency, ratio = each @ bins.count
    size = len(factor)
    means = np.exp(log_frequency / count), ratio / count, count / size
    together = Bins(*(np.full(size, value) for value in means))
    return Rows(factor * np.sqrt(variance(together) / together.count)[:, None], together)


class NormalEquations:
    """AᵀA (c, c) of the columns A of all rows, brought to unit variance by any spectrum.

    The rows of a band that were joined have one variance: their products are summed once.

    model : spectrum by which `white` (M + m, c), rows and then priors, is of unit variance.
    The first column is the residual, the others are a Jacobian.
    """

    def __init__(self, rows: Rows, model: NoiseModel, white: FloatArray) -> None:
        bins, M = rows.bins, len(rows.design)
        first = np.flatnonzero(
            (np.diff(bins.frequency, prepend=np.nan) != 0)
            | (np.diff(bins.ratio, prepend=np.nan) != 0)
        )
        length = np.diff(first, append=M)
        joined, single = first[length > 1], first[length == 1]
        ends = [*zip(joined, joined + length[length > 1], strict=True), (M, len(white))]
        self._gram = np.stack([white[a:b].T @ white[a:b] for a, b in ends])
        self._white, self._rows, self._model = white[single], len(white), model
        self._bins, self._singles = bins.some(np.concatenate([single, joined])), len(single)
        self._variance = model.variance(self._bins)

    def solved(self, log_density: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Step (p,) to the minimum, and the root (p, r) of the step's covariance.

        log_density : (2H,), parameters of the spectrum.
        """
        model = replace(self._model, log_density=log_density)
        weight = self._variance / model.variance(self._bins)
        single, joined = np.split(weight, [self._singles])
        part = self._white * np.sqrt(single)[:, None]
        normal = np.tensordot([*joined, 1.0], self._gram, axes=1) + part.T @ part
        root = gram_root(normal[1:, 1:], self._rows)
        return -root @ (root.T @ normal[1:, 0]), root
