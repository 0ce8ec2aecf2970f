"""Fourier coefficients of all blocks as rows of independent noise, of bounded number.

In the common eigenvectors of the two parts of its noise the components of a block's wrench (six
where every axis is measured) are independent. Rows of one component and of neighbouring
frequencies, which a long log has many of, are brought to one scale by the spectrum as it was last
seen and stand as one triangular factor with a common variance: a statistic whose size no log's
length changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tdfscal.frozen import record
from tdfscal.motioncal.blocks import ComplexArray
from tdfscal.motioncal.design import BlockDesign
from tdfscal.motioncal.noise import Bins, NoiseModel
from tdfscal.numerics.least_squares import gram_root, triangular
from tdfscal.records import FloatArray

#: Ratio of the frequencies of neighbouring bands.
_BAND = 1.2
#: Real rows of one band that are gathered before they are factored.
_GATHERED = 512


@record
class Rows:
    """All blocks in their independent components, M rows, of which the first C are complex.

    design : (M + C, q + 13 + s + all rests), real parts of all, then imaginary ones of the first C.
    bins : their M frequencies and weights.
    """

    design: FloatArray
    bins: Bins

    @property
    def complex(self) -> int:
        """How many rows have an imaginary part."""
        return len(self.design) - len(self.bins.count)

    def scaled(self, columns: FloatArray, factor: FloatArray) -> FloatArray:
        """Columns (M + C, ...) of these rows, each row times its factor (M,)."""
        both = np.concatenate([factor, factor[: self.complex]])
        return np.asarray(columns * both.reshape(-1, *(1,) * (columns.ndim - 1)))

    def weighted(self, columns: FloatArray, variance: FloatArray) -> FloatArray:
        """Columns (M + C, ...) of these rows, white where every row has its variance (M,)."""
        return self.scaled(columns, np.sqrt(self.bins.count / variance))

    def power(self, columns: FloatArray) -> FloatArray:
        """|columns|² (M,) of these rows, summed over all columns (M + C, c)."""
        square = np.einsum("kc,kc->k", columns, columns)
        square[: self.complex] += square[len(self.bins.count) :]
        return np.asarray(square[: len(self.bins.count)])


def reading_gain(item: BlockDesign, model: NoiseModel) -> FloatArray:
    """Σ_f S_F S⁻¹ in the wrench's own components, (6, 6): what noise in the readings counts."""
    bins, mix = item.bins, item.mix
    gain = bins.count * model.density(bins.frequency)[0] / model.variance(bins)
    return np.asarray(mix.T @ np.diag(gain.reshape(-1, len(mix)).sum(axis=0)) @ mix)


def rows_of(item: BlockDesign, all_rests: int) -> Rows:
    """Rows (r F) of one block, none of them joined; all_rests : turns at all rests of the log."""
    cut, size = item.design.shape[2], len(item.bins.count)
    design = np.zeros((2, size, cut + all_rests))
    design[:, :, :cut] = mixed(item.mix, item.design)
    design[:, :, cut:][:, :, item.place] = mixed(item.mix, item.rests)
    return Rows(design.reshape(2 * size, -1), item.bins)


def mixed(mix: FloatArray, columns: ComplexArray) -> FloatArray:
    """Real and imaginary parts (2, r F, c) of columns (F, 6, c) in other components."""
    F, _, c = columns.shape
    both = (mix @ np.ascontiguousarray(columns).view(np.float64)).reshape(len(mix) * F, c, 2)
    return np.moveaxis(both, 2, 0)


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
    parts = (rows_of(item, all_rests) for item in designs)
    lines = sum(len(item.block.frequency) for item in designs)
    columns = designs[0].design.shape[2] + all_rests
    if len(designs) == 1 and 2 * lines * (1 - 1 / _BAND) <= columns:
        return next(parts)
    low = min(float(item.block.frequency[1]) for item in designs) / 2
    bands: dict[int, _Band] = {}
    for part in parts:
        for key, own in _banded(part, len(designs[0].mix), low):
            bands.setdefault(key, _Band(columns, model)).add(own)
    return _stacked([band.rows() for _, band in sorted(bands.items())])


def _banded(part: Rows, r: int, low: float) -> Iterator[tuple[int, Rows]]:
    """A number for each band and each of r components, and the rows of both; low : Hz."""
    bins, parts = part.bins, part.design.reshape(2, part.complex, -1)
    band = np.floor(np.log(bins.frequency / low) / np.log(_BAND) + 1e-9).astype(int)
    number = r * band + np.arange(len(band)) % r
    for k in np.unique(number):
        own = number == k
        yield int(k), Rows(np.concatenate(parts[:, own]), bins.some(own))


def _stacked(parts: Sequence[Rows]) -> Rows:
    """Rows together, complex ones first."""
    parts = sorted(parts, key=lambda part: part.complex == 0)
    real = [part.design[: len(part.bins.count)] for part in parts]
    imaginary = [part.design[len(part.bins.count) :] for part in parts]
    bins = Bins.stacked([part.bins for part in parts])
    return Rows(np.concatenate([*real, *imaginary]), bins)


@dataclass(slots=True)
class _Band:
    """Rows of one band and one component, as they come."""

    columns: int
    model: NoiseModel | None
    parts: list[Rows] = field(default_factory=list)
    waiting: int = 0
    #: Triangular factor of what was joined, per unit of the reference's variance.
    factor: FloatArray | None = None
    #: Sums over what was joined: of the counts, and of these times log f and times λ.
    sums: FloatArray = field(default_factory=lambda: np.zeros(3))

    def add(self, part: Rows) -> None:
        """Add rows of a block."""
        self.parts.append(part)
        self.waiting += len(part.design)
        if self.waiting > max(_GATHERED, 2 * self.columns):
            self._join()

    def rows(self) -> Rows:
        """Rows as they came, or one triangular factor where they are more than columns."""
        if self.factor is None and self.waiting <= self.columns:
            return _stacked(self.parts)
        if self.parts:
            self._join()
        assert self.factor is not None
        count, log_frequency, ratio = self.sums
        size = len(self.factor)
        each = np.exp(log_frequency / count), ratio / count, count / size
        bins = Bins(*(np.full(size, value) for value in each))
        return Rows(self.factor * np.sqrt(self._variance(bins) / bins.count)[:, None], bins)

    def _join(self) -> None:
        part = _stacked(self.parts)
        own = part.weighted(part.design, self._variance(part.bins))
        self.factor = triangular(own if self.factor is None else np.concatenate([self.factor, own]))
        self.parts, self.waiting = [], 0
        bins = part.bins
        each = [np.ones(len(bins.count)), np.log(bins.frequency), bins.ratio]
        self.sums = self.sums + np.stack(each) @ bins.count

    def _variance(self, bins: Bins) -> FloatArray:
        return np.ones(len(bins.count)) if self.model is None else self.model.variance(bins)


class NormalEquations:
    """AᵀA (c, c) of the columns A of all rows, brought to unit variance by any spectrum.

    The rows of a band that were joined have one variance: their products are summed once.

    model : spectrum by which `white` (M + C + m, c), rows and then priors, is of unit variance.
    The first column is the residual, the others are a Jacobian.
    """

    def __init__(self, rows: Rows, model: NoiseModel, white: FloatArray) -> None:
        M, C, bins = len(rows.bins.count), rows.complex, rows.bins
        self._model, self._rows = model, len(white)
        joined = np.flatnonzero(
            (np.diff(bins.frequency[C:], prepend=np.nan) != 0)
            | (np.diff(bins.ratio[C:], prepend=np.nan) != 0)
        )
        parts = [white[a:b] for a, b in pairwise([*(C + joined), M])] + [white[M + C :]]
        self._gram = np.stack([part.T @ part for part in parts])
        self._single = np.concatenate([white[:C], white[M : M + C]])
        once = np.concatenate([np.arange(C), C + joined])
        self._bins = bins.some(once)
        self._complex, self._variance = C, model.variance(self._bins)

    def solved(self, log_density: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Step (p,) to the minimum, and the root (p, r) of the step's covariance.

        log_density : (2H,), parameters of the spectrum.
        """
        weight = self._variance / self._model.variance(self._bins, log_density)
        single, joined = weight[: self._complex], weight[self._complex :]
        part = self._single * np.sqrt(np.concatenate([single, single]))[:, None]
        normal = np.tensordot([*joined, 1.0], self._gram, axes=1) + part.T @ part
        root = gram_root(normal[1:, 1:], self._rows)
        return -root @ (root.T @ normal[1:, 0]), root
