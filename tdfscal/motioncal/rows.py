"""Fourier coefficients of all blocks as rows of independent noise, of bounded number.

In the common eigenvectors of the two parts of its noise the components of a block's wrench (six
where every axis is measured) are independent. Rows of one component and of neighbouring
frequencies, which a long log has many of, are brought to one scale by the spectrum as it was last
seen and stand as one triangular factor with a common variance: a statistic whose size no log's
length changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.frozen import record
from tdfscal.motioncal.design import BlockDesign
from tdfscal.motioncal.noise import Bins, NoiseModel
from tdfscal.numerics.least_squares import gram_root, triangular
from tdfscal.records import FloatArray

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


def reading_gain(item: BlockDesign, model: NoiseModel) -> FloatArray:
    """Σ_f S_F S⁻¹ in the wrench's own components, (6, 6): what noise in the readings counts."""
    bins, mix = item.bins, item.mix
    gain = bins.count * model.density(bins.frequency)[0] / model.variance(bins)
    return np.asarray(mix.T @ np.diag(gain.reshape(-1, len(mix)).sum(axis=0)) @ mix)


def rows_of(item: BlockDesign, all_rests: int) -> Rows:
    """Rows of one block, none of them joined; all_rests : turns at all rests of the log."""
    cut = item.design.shape[2]
    design = np.zeros((len(item.bins.count), cut + all_rests))
    design[:, :cut] = item.real(item.design)
    design[:, cut:][:, item.place] = item.real(item.rests)
    return Rows(design, item.bins)


def rms(designs: Sequence[BlockDesign], psi: FloatArray) -> FloatArray:
    """Quadratic means (2,) over time of the wrench of some blocks, N and N·m about c."""
    each = [item.block.seconds * item.block.power(item.wrench(psi)) for item in designs]
    seconds = sum(item.block.seconds for item in designs)
    return np.asarray(np.sqrt(np.sum(each, axis=0).reshape(2, 3).sum(axis=1) / seconds))


def gather(designs: Sequence[BlockDesign], model: NoiseModel | None) -> Rows:
    """Rows of all blocks, joined where they are more than columns.

    model : the spectrum as last seen, by which the rows of a band are brought to one scale.
    """
    all_rests = max(item.place.stop for item in designs)
    low = min(float(item.block.frequency[1]) for item in designs) / 2
    bands: dict[int, _Band] = {}
    for item in designs:
        part, r = rows_of(item, all_rests), len(item.mix)
        band = np.floor(np.log(part.bins.frequency / low) / np.log(_BAND) + 1e-9).astype(int)
        number = r * band + np.arange(len(band)) % r
        for k in np.unique(number).tolist():
            own = number == k
            band_rows = Rows(part.design[own], part.bins.some(own))
            bands.setdefault(k, _Band(model)).add(band_rows)
    return Rows.stacked([band.rows() for _, band in sorted(bands.items())])


class _Band:
    """Rows of one band and one component, as they come."""

    def __init__(self, model: NoiseModel | None) -> None:
        self._model = model
        self._parts: list[Rows] = []
        #: Triangular factor of what was joined, per unit of the reference's variance.
        self._factor: FloatArray | None = None
        #: Sums over what was joined: of the counts, and of these times log f and times λ.
        self._sums = np.zeros(3)

    def add(self, part: Rows) -> None:
        """Add rows of a block."""
        self._parts.append(part)
        if self._waiting > max(_GATHERED, 2 * part.design.shape[1]):
            self._join()

    @property
    def _waiting(self) -> int:
        return sum(len(part.design) for part in self._parts)

    def rows(self) -> Rows:
        """Rows as they came, or one triangular factor where they are more than columns."""
        if self._factor is None and self._waiting <= self._parts[0].design.shape[1]:
            return Rows.stacked(self._parts)
        if self._parts:
            self._join()
        assert self._factor is not None
        count, log_frequency, ratio = self._sums
        size = len(self._factor)
        each = np.exp(log_frequency / count), ratio / count, count / size
        bins = Bins(*(np.full(size, value) for value in each))
        return Rows(self._factor * np.sqrt(self._variance(bins) / bins.count)[:, None], bins)

    def _join(self) -> None:
        part = Rows.stacked(self._parts)
        own = [part.weighted(part.design, self._variance(part.bins))]
        if self._factor is not None:
            own.append(self._factor)
        self._factor, self._parts, bins = triangular(np.concatenate(own)), [], part.bins
        each = [np.ones(len(bins.count)), np.log(bins.frequency), bins.ratio]
        self._sums = self._sums + np.stack(each) @ bins.count

    def _variance(self, bins: Bins) -> FloatArray:
        return np.ones(len(bins.count)) if self._model is None else self._model.variance(bins)


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
        weight = self._variance / self._model.variance(self._bins, log_density)
        single, joined = np.split(weight, [self._singles])
        part = self._white * np.sqrt(single)[:, None]
        normal = np.tensordot([*joined, 1.0], self._gram, axes=1) + part.T @ part
        root = gram_root(normal[1:, 1:], self._rows)
        return -root @ (root.T @ normal[1:, 0]), root
