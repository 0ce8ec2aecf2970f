"""Gaussians in information form: sums, random walks and contrasts, singular ones included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import BoolArray, FloatArray

#: Directions with less than this share of the largest information carry none.
_ROUNDING = 1e-11
#: Share of what is known of a direction below which nothing was added to it.
_NEW = 1e-6


@dataclass(frozen=True, slots=True)
class Information:
    """Λ (C, C) and η (C,) with Λ x = η at the mean, x counted from some common reference."""

    matrix: FloatArray
    score: FloatArray

    def __add__(self, other: Information) -> Information:
        return Information(self.matrix + other.matrix, self.score + other.score)

    def __sub__(self, other: Information) -> Information:
        return Information(self.matrix - other.matrix, self.score - other.score)

    @property
    def covariance(self) -> FloatArray:
        """(C, C); the information must determine every constant."""
        return inverse(self.matrix)

    @property
    def mean(self) -> FloatArray:
        """(C,), from the reference."""
        return np.asarray(self.covariance @ self.score)

    def walked(self, variance: FloatArray) -> Information:
        """Return what is left after the constants walked with variance (C,): (Λ⁻¹ + Q)⁻¹."""
        if not variance.any():
            return self
        keep = np.linalg.inv(np.eye(len(variance)) + self.matrix * variance)
        matrix = keep @ self.matrix
        return Information((matrix + matrix.T) / 2, keep @ self.score)

    def without(self, lost: BoolArray) -> Information:
        """Return what is said of all others where nothing is known of the constants `lost` (C,)."""
        if not lost.any():
            return self
        kept = ~lost
        scale = np.sqrt(np.maximum(np.diagonal(self.matrix), np.finfo(float).tiny))
        unit = self.matrix / scale[:, None] / scale
        inner = np.linalg.pinv(unit[np.ix_(lost, lost)], rcond=_ROUNDING, hermitian=True)
        give = unit[np.ix_(kept, lost)] @ inner
        score, out = self.score / scale, nothing(len(lost))
        rest = unit[np.ix_(kept, kept)] - give @ unit[np.ix_(lost, kept)]
        out.matrix[np.ix_(kept, kept)] = (rest + rest.T) / 2 * scale[kept, None] * scale[kept]
        out.score[kept] = (score[kept] - give @ score[lost]) * scale[kept]
        return out

    def scaled(self, birge: float) -> Information:
        """Return the same with all standard deviations multiplied by birge."""
        return Information(self.matrix / birge**2, self.score / birge**2)


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a positive definite matrix (C, C), its constants scaled to one another."""
    scale = 1 / np.sqrt(np.diagonal(matrix))
    inner = np.linalg.inv(scale[:, None] * matrix * scale)
    return np.asarray(scale[:, None] * (inner + inner.T) / 2 * scale)


def without(whole: Information, part: Information) -> Information:
    """Take away what was known before, and all of which next to nothing is new.

    An estimate is settled to a small share of its uncertainty: more than that is no information,
    and rounding leaves none that is negative.
    """
    here = np.diagonal(whole.matrix) > 0
    scale = 1 / np.sqrt(np.diagonal(whole.matrix)[here])
    rest, out = whole - part, nothing(len(here))
    lower = np.linalg.cholesky(scale[:, None] * whole.matrix[np.ix_(here, here)] * scale)
    half = np.linalg.solve(lower, scale[:, None] * rest.matrix[np.ix_(here, here)] * scale)
    share, vectors = np.linalg.eigh(np.linalg.solve(lower, half.T))
    new = share > _NEW
    back = lower @ vectors[:, new] / scale[:, None]
    out.matrix[np.ix_(here, here)] = (back * share[new]) @ back.T
    out.score[here] = back @ (vectors[:, new].T @ np.linalg.solve(lower, scale * rest.score[here]))
    return out


def nothing(size: int) -> Information:
    """Information of size C that says nothing."""
    return Information(np.zeros((size, size)), np.zeros(size))


@dataclass(frozen=True, slots=True)
class Contrast:
    """Difference of two independent estimates, each perhaps of a part of the constants.

    matrix : M = (Λ_a⁻¹ + Λ_b⁻¹)⁻¹ (C, C), information on the difference, singular where either is.
    score : M (x_b − x_a) (C,).
    """

    matrix: FloatArray
    score: FloatArray

    def chi2(self, where: slice | None = None) -> tuple[float, int]:
        """χ² and degrees of freedom of a change of the constants at `where`, all others unchanged.

        A change of everything without `where`.
        """
        part = slice(None) if where is None else where
        values, vectors = np.linalg.eigh(self.matrix[part, part])
        seen = values > _ROUNDING * max(values.max(initial=0.0), np.finfo(float).tiny)
        along = vectors[:, seen].T @ self.score[part]
        return float(np.sum(along**2 / values[seen])), int(seen.sum())

    def change(self, where: slice) -> tuple[FloatArray, FloatArray]:
        """Most likely change of the constants at `where` alone, and its covariance."""
        covariance = np.linalg.pinv(self.matrix[where, where], rcond=_ROUNDING, hermitian=True)
        return np.asarray(covariance @ self.score[where]), np.asarray(covariance)


def contrast(a: Information, b: Information) -> Contrast:
    """B against a; their sum must determine every constant."""
    scale = 1 / np.sqrt(np.diagonal(a.matrix + b.matrix))
    A, B = (scale[:, None] * part.matrix * scale for part in (a, b))
    total = np.linalg.inv(A + B)
    M = A @ total @ B
    score = A @ total @ (scale * b.score) - B @ total @ (scale * a.score)
    return Contrast((M + M.T) / 2 / scale[:, None] / scale, score / scale)


def p_value(found: tuple[float, int]) -> float:
    """Probability that chance alone gives more than this χ² with its degrees of freedom."""
    return float(chi2_sf(*found)) if found[1] else 1.0
