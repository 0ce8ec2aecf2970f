"""Points that a file holds several times: measured again, as in a repeatability check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.records import FloatArray, IntArray

#: Of the way to the nearest other point: what lies farther apart is no measurement repeated.
_APART = 0.1
#: Times the middle spread of the points, beyond which one reading is wrong.
_WRONG = 10.0
#: Repeated points from which their middle spread is known.
_SEVERAL = 3


@dataclass(frozen=True, slots=True)
class Repeated:
    """Rows of a point file by their points.

    first : (M,), the first row of each point. member : (N,), which point each row is.
    scatter : standard deviation of a coordinate about its point's mean, in the unit of the
    coordinates, with `dof` degrees of freedom; 0 where no point is repeated.
    """

    first: IntArray
    member: IntArray
    scatter: float
    dof: int

    @property
    def of_means(self) -> float:
        """Standard uncertainty of a coordinate of a point's mean, by the scatter."""
        return self.scatter / float(np.sqrt(len(self.member) / len(self.first)))

    def mean(self, value: FloatArray) -> FloatArray:
        """Mean (M, 3) of the rows (N, 3) of each point; NaN counts only where nothing else is."""
        there = np.isfinite(value)
        total = np.zeros((len(self.first), value.shape[1]))
        count = total.copy()
        np.add.at(total, self.member, np.where(there, value, 0.0))
        np.add.at(count, self.member, there)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def repeated(names: Sequence[tuple[str, str]], xyz: FloatArray) -> Repeated:
    """Tell which rows (N, 3) are the same point, by group and name."""
    place = {name: k for k, name in enumerate(dict.fromkeys(names))}
    member = np.array([place[name] for name in names], dtype=np.int64)
    first = np.unique(member, return_index=True)[1]
    rows = Repeated(first, member, 0.0, 3 * (len(names) - len(first)))
    if not rows.dof:
        return rows
    square = float(np.sum((xyz - rows.mean(xyz)[member]) ** 2))
    return Repeated(first, member, float(np.sqrt(square / rows.dof)), rows.dof)


def misplaced(rows: Repeated, xyz: FloatArray) -> tuple[int, float] | None:
    """Return the row that is no further measurement of its point, and how far off it is.

    It lies nearer to another point than such a one could, or far from its others where the rest
    of the points repeat well. None where all are repeated as they should.
    """
    count = np.bincount(rows.member)
    if not rows.dof:
        return None
    middle = rows.mean(xyz)
    off = np.linalg.norm(xyz - xyz[rows.first][rows.member], axis=1)
    limit = np.empty(len(count))
    for k, here in enumerate(middle):
        others = np.delete(middle, k, axis=0)
        limit[k] = _APART * np.linalg.norm(others - here, axis=1).min(initial=np.inf)
    limit[np.isinf(limit)] = 0.0  # a file of one point: nothing tells a repetition from a mistake
    spread = np.zeros(len(count))
    np.maximum.at(spread, rows.member, np.linalg.norm(xyz - middle[rows.member], axis=1))
    if np.sum(count > 1) >= _SEVERAL:
        limit = np.minimum(limit, _WRONG * np.median(spread[count > 1]))
    wrong = np.flatnonzero(off > np.where(count > 1, limit, np.inf)[rows.member])
    return (int(wrong[0]), float(off[wrong[0]])) if len(wrong) else None
