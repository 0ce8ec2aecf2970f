"""The normal equations of a fit under any spectrum of its noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tdfscal.motioncal.noise import Bins, NoiseModel
from tdfscal.motioncal.rows import Rows
from tdfscal.numerics.least_squares import gram_root
from tdfscal.records import FloatArray


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
        self._bins = Bins(bins.frequency[once], bins.ratio[once], bins.count[once])
        self._complex, self._variance = C, model.variance(self._bins)

    def at(self, log_density: FloatArray) -> FloatArray:
        """AᵀA (c, c), where the spectrum's parameters are these."""
        weight = self._variance / self._model.variance(self._bins, log_density)
        single, joined = weight[: self._complex], weight[self._complex :]
        part = self._single * np.concatenate([single, single])[:, None]
        total = np.tensordot([*joined, 1.0], self._gram, axes=1)
        return np.asarray(total + part.T @ self._single)

    def solved(self, log_density: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Step (p,) to the minimum, and the root (p, r) of the step's covariance."""
        normal = self.at(log_density)
        root = gram_root(normal[1:, 1:], self._rows)
        return -root @ (root.T @ normal[1:, 0]), root
