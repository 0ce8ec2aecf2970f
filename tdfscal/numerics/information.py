"""Gaussians in information form: sums, random walks and contrasts, singular ones included."""

from __future__ import annotations

import numpy as np

from tdfscal.frozen import record
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import BoolArray, FloatArray, IntArray

#: Some of the constants (C,).
Places = slice | BoolArray | IntArray
_ALL = slice(None)
#: Directions with less than this share of the largest information carry none.
_ROUNDING = 1e-11
#: Share of what is known of a direction below which nothing was added to it, or nothing is left to
#: hold it against: it rests on one part alone, a thousand times surer than the other.
_NEW = 1e-6
#: Share of what is known of a direction, beside what was stated, below which measurements hold no
#: test of it: their column is noise there, and so is their score, of the second order and not
#: centred (theory, section 13).
_TELLING = 0.01


@record
class Information:
    """Λ (C, C) and η (C,) with Λ x = η at the mean, x counted from some common reference.

    Sums, walks and means take several scores beside each other as well, (C, c).
    """

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

    def beside(self, stated: Information) -> Information:
        """Return what measurements say in directions of which more than what is stated is known.

        Where 1 % or less of what both know is theirs, they hold no test.
        """
        share, basis, dual = _shares(self.matrix, self.matrix + stated.matrix)
        told = share > _TELLING
        matrix = (basis[:, told] * share[told]) @ basis[:, told].T
        return Information(matrix, basis[:, told] @ (dual[told] @ self.score))

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
    rest, out, block = whole - part, nothing(len(here)), np.ix_(here, here)
    share, basis, dual = _shares(rest.matrix[block], whole.matrix[block])
    new = share > _NEW
    out.matrix[block] = (basis[:, new] * share[new]) @ basis[:, new].T
    out.score[here] = basis[:, new] @ (dual[new] @ rest.score[here])
    return out


@record
class Gain:
    """What further data changed of an estimate; all (C, C).

    covariance : of the change. information : on the change, none in directions to which the data
    added next to nothing. seen : on an error of the further data's constants, by the change.
    """

    covariance: FloatArray
    information: FloatArray
    seen: FloatArray


def gain(before: FloatArray, after: FloatArray) -> Gain:
    """Return what is known of the change of an estimate by further data, from covariances (C, C).

    The best estimate from all data is uncorrelated with its difference from any other unbiased one
    of the same constants, or else a mixture of both were better (Gauss and Markov): the change has
    C_before − C_after. The further data alone differ from the earlier estimate by the change times
    C_before (C_before − C_after)⁻¹. Below 1 % of C_before no change is told from what the linear
    model leaves out; as covariance that much is returned.
    """
    share, basis, dual = _shares(before - after, before)
    told = share > _TELLING
    change, part = dual[told], share[told]
    return Gain(
        (basis * np.maximum(share, _TELLING)) @ basis.T,
        (change.T / part) @ change,
        (change.T * part) @ change,
    )


def _shares(part: FloatArray, whole: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Directions in which both are diagonal: whole = B Bᵀ, part = B diag(f) Bᵀ; all (C, C).

    Returns shares f (C,), B, and B⁻¹, which takes a score to these directions.
    """
    scale = 1 / np.sqrt(np.diagonal(whole))
    lower = np.linalg.cholesky(scale[:, None] * whole * scale)
    half = np.linalg.solve(lower, scale[:, None] * part * scale)
    share, vectors = np.linalg.eigh(np.linalg.solve(lower, half.T))
    dual = np.linalg.solve(lower.T, vectors).T * scale
    return share, lower @ vectors / scale[:, None], dual


def nothing(size: int) -> Information:
    """Information of size C that says nothing."""
    return Information(np.zeros((size, size)), np.zeros(size))


@record
class Contrast:
    """Difference of two independent estimates, each perhaps of a part of the constants.

    matrix : M = (Λ_a⁻¹ + Λ_b⁻¹)⁻¹ (C, C), information on the difference, singular where either is.
    score : M (x_b − x_a) (C,).
    """

    matrix: FloatArray
    score: FloatArray

    def chi2(self, where: Places = _ALL) -> tuple[float, int]:
        """χ² and degrees of freedom of a change of the constants at `where`, all others unchanged.

        A change of everything without `where`.
        """
        values, vectors, scale = self._seen(where)
        along = vectors.T @ (scale * self.score[where])
        return float(np.sum(along**2 / values)), len(values)

    def change(self, where: Places) -> tuple[FloatArray, FloatArray]:
        """Most likely change of the constants at `where` alone, and its covariance."""
        values, vectors, scale = self._seen(where)
        root = scale[:, None] * vectors / np.sqrt(values)
        return root @ (root.T @ self.score[where]), root @ root.T

    def turn_p(self, sensors: int) -> FloatArray:
        """Chance (n,) of as much χ² as a turn of each of n sensors alone takes; they come first."""
        each = np.arange(3 * sensors).reshape(-1, 3)
        return np.array([p_value(self.chi2(where)) for where in each])

    def left(self, where: Places) -> tuple[float, int]:
        """χ² and degrees of freedom that a change of the constants at `where` does not explain."""
        (whole, rank), (explained, unknowns) = self.chi2(), self.chi2(where)
        return max(0.0, whole - explained), rank - unknowns

    def _seen(self, where: Places) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Eigenvalues and vectors of what is seen of `where`, scaled to one another, and scale."""
        block = self.matrix[where][:, where]
        scale = np.diagonal(block)
        scale = np.divide(1.0, np.sqrt(scale), out=np.zeros(len(scale)), where=scale > 0)
        values, vectors = np.linalg.eigh(scale[:, None] * block * scale)
        seen = values > _ROUNDING * values.max(initial=1.0)
        return values[seen], vectors[:, seen], scale


@record
class Equations:
    """Many equations, summed: what they say of the parameters (P,), their χ², their number."""

    seen: Information
    chi2: float
    rows: int

    def scaled(self, variance: float) -> Equations:
        """The same with the noise's variance this many times larger."""
        return Equations(self.seen.scaled(np.sqrt(variance)), self.chi2 / variance, self.rows)

    def given(self, prior: FloatArray) -> Equations:
        """Whitened by what parameters with a prior std (P,), 0 exact, add to the noise."""
        seen = self.seen.walked(prior**2)
        return Equations(
            seen, self.chi2 - float(self.seen.score @ (prior**2 * seen.score)), self.rows
        )

    def apart_from(self, free: BoolArray) -> tuple[Equations, int]:
        """Without what parameters (P,) of which nothing is known explain; and their rank."""
        explained, rank = Contrast(self.seen.matrix, self.seen.score).chi2(free)
        return Equations(self.seen.without(free), self.chi2 - explained, self.rows), rank


def contrast(a: Information, b: Information) -> Contrast:
    """B against a, in the directions of which both know something; their sum must determine all.

    In the basis where Λ_a + Λ_b = 1 and Λ_b is diagonal with shares f, M has f (1 − f) (theory,
    section 13).

    Parameters
    ----------
    a : the rest, with all that is stated of the constants. b : a part, by its measurements alone.
        One of many has a small share beside the rest, and tests none the worse where it measures.
    """
    share, basis, dual = _shares(b.matrix, a.matrix + b.matrix)
    both = (share > _NEW) & (share < 1 - _NEW)
    f, basis, dual = share[both], basis[:, both], dual[both]
    score = (1 - f) * (dual @ b.score) - f * (dual @ a.score)
    return Contrast((basis * (f * (1 - f))) @ basis.T, basis @ score)


def p_value(found: tuple[float, int]) -> float:
    """Probability that chance alone gives more than this χ² with its degrees of freedom."""
    return float(chi2_sf(*found)) if found[1] else 1.0
