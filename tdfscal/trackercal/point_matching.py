"""Which measured point is which reference point: by name or order, checked by the distances."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping, Sequence
from itertools import permutations
from typing import Literal

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray, PointSet

_ALL_PERMUTATIONS_UP_TO = 6  # 720; beyond it, points are told apart by their sorted distances
LISTED = 8
"""Names that a message lists at most."""
_MOST_COMPARED = 1000  # points whose distances to all others are looked at
_UNITS = {
    "mm read as m": 1000.0,
    "inches read as mm": 25.4,
    "inches read as m": 1000 / 25.4,
}
_UNITS |= {"µm read as mm": 1000.0, "µm read as m": 1e6}


Match = Literal["name", "point", "order"]
_BY = {"name": "group and name", "point": "name", "order": "place"}


@record
class MatchedPoints:
    """Points that two sets have in common, in the reference set's order, each in its own frame.

    missing : "group/point" of the reference that were not measured. extra : the reverse.
    """

    measured: PointSet
    reference: PointSet
    missing: tuple[str, ...]
    extra: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.reference.point)

    @property
    def names(self) -> tuple[str, ...]:
        """Return "group/point" of each point."""
        return _names(self.reference)

    @property
    def groups(self) -> tuple[str, ...]:
        """Return the groups, each once."""
        return tuple(dict.fromkeys(self.reference.group))

    def take(self, which: Sequence[int] | IntArray) -> MatchedPoints:
        """Only the points with these indices; missing and extra ones are left as they are."""
        return replace(
            self, measured=self.measured.take(which), reference=self.reference.take(which)
        )

    def indices(self, group: str) -> IntArray:
        """Where the points of one group are."""
        return np.flatnonzero([g == group for g in self.reference.group])


def match_points(
    measured: PointSet,
    reference: PointSet,
    match: Match = "name",
    groups: Mapping[str, str] | None = None,
) -> MatchedPoints:
    """Pair the points of two sets.

    match : "name", group and point, or the point alone where one of the files has no groups;
    "point", whatever the groups; "order", row by row. groups : measured group → reference group,
    where they are named differently.

    Raises
    ------
    DataError : nothing is common to both, or what is common fits several points.
    """
    measured = _renamed(measured, groups or {}, reference)
    ours, theirs = _keys(measured, reference, match)
    where = {key: i for i, key in enumerate(ours)}
    common = {j: where[key] for j, key in enumerate(theirs) if key in where}
    names, others = _names(reference), _names(measured)
    if not common:
        values: dict[str, Value] = {
            "by": _BY[match],
            "file": reference.source,
            "measured": _listed(others),
            "reference": _listed(names),
        }
        raise DataError(Finding("points-unmatched", values=values), where=measured.source)
    taken = set(common.values())
    return MatchedPoints(
        measured=measured.take(list(common.values())),
        reference=reference.take(list(common)),
        missing=tuple(name for k, name in enumerate(names) if k not in common),
        extra=tuple(name for k, name in enumerate(others) if k not in taken),
    )


def _renamed(measured: PointSet, groups: Mapping[str, str], reference: PointSet) -> PointSet:
    for names, known, source in (
        (groups, measured.group, measured.source),
        (groups.values(), reference.group, reference.source),
    ):
        for name in names:
            if name not in known:
                there = ", ".join(dict.fromkeys(filter(None, known))) or "none"
                missing = Finding("point-group-missing", (name,), values={"groups": there})
                raise DataError(missing, where=source)
    return replace(measured, group=tuple(groups.get(g, g) for g in measured.group))


def _keys(
    measured: PointSet, reference: PointSet, match: Match
) -> tuple[Sequence[Hashable], Sequence[Hashable]]:
    """What the points of either set go by."""
    sets = (measured, reference)
    if match == "order":
        counts = [len(points.point) for points in sets]
        if counts[0] != counts[1]:
            values: dict[str, Value] = {"file": reference.source, "other": counts[1]}
            unequal = Finding("points-uncounted", size=counts[0], values=values)
            raise DataError(unequal, where=measured.source)
        return range(counts[0]), range(counts[1])
    if match == "name" and any(measured.group) and any(reference.group):
        ours, theirs = (list(zip(p.group, p.point, strict=True)) for p in sets)
        return ours, theirs
    if match == "name" and not any(measured.group):
        # A recorder without groups writes the support into the point's name: ncp1_P1.
        full, grouped = [_folded(p) for p in measured.point], map(_folded, _names(reference))
        named = [name if g else None for g, name in zip(reference.group, grouped, strict=True)]
        if set(full) & set(named):
            return full, named
    common = set(measured.point) & set(reference.point)
    for points in sets:
        twice = next((p for p in points.point if p in common and points.point.count(p) > 1), None)
        if twice is not None:
            raise DataError(Finding("points-ungrouped", (twice,)), where=points.source)
    return measured.point, reference.point


def _folded(name: str) -> str:
    return re.sub(r"[\s_./:-]+", " ", name).strip().lower()


def _names(points: PointSet) -> tuple[str, ...]:
    """Return "group/point" of each point; the point alone where there is no group."""
    named = zip(points.group, points.point, strict=True)
    return tuple("/".join(filter(None, name)) for name in named)


def unmatched(points: MatchedPoints) -> tuple[Finding, ...]:
    """Name the missing and the extra points, if any."""
    return tuple(
        Finding(code, (points.measured.source,), len(names), values={"points": names})
        for code, names in (
            ("points-not-measured", points.missing),
            ("points-without-reference", points.extra),
        )
        if names
    )


def unit_mistake(points: MatchedPoints) -> str | None:
    """What a ratio of the two sets' sizes far from one looks like, in words.

    The size is the rms distance from the centroid, which no permutation of the points changes.
    """
    sizes = [np.sqrt(p.xyz.var(axis=0).sum()) for p in (points.measured, points.reference)]
    if min(sizes) == 0 or 0.95 < sizes[0] / sizes[1] < 1.05:
        return None
    ratios = {"measured": sizes[0] / sizes[1], "reference": sizes[1] / sizes[0]}
    for text, factor in _UNITS.items():
        for name, ratio in ratios.items():
            if abs(ratio / factor - 1) < 0.02:
                size = f"{ratio:.4g} times as large as the others"
                return f"the {name} points are {size}, as with {text}"
    return None


def same_distances(measured: PointSet, reference: PointSet, sigma: float) -> bool:
    """Whether all distances within the sets agree within 5 √2 sigma, m."""
    few = slice(None, None, 1 + len(measured.xyz) // _MOST_COMPARED)
    gap = np.abs(_distances(measured.xyz[few]) - _distances(reference.xyz[few]))
    return bool(gap.max() <= 5 * np.sqrt(2) * sigma)


def relabellings(points: MatchedPoints, sigma: float) -> list[IntArray]:
    """Permutations π, but the identity, under which measured[π] has the distances of reference.

    sigma : m, standard uncertainty of a coordinate difference; distances agree within 5 √2 sigma,
    and a rotation (not only a reflection) brings the points to within 5 √3 sigma. Best first.
    """
    count = len(points)
    if count > _MOST_COMPARED:  # so many are named by a program
        return []
    y, x = (p.xyz - p.xyz.mean(axis=0) for p in (points.measured, points.reference))
    Dm, Dr = _distances(y), _distances(x)
    if count <= _ALL_PERMUTATIONS_UP_TO:
        candidates = np.array(list(permutations(range(count))))
    else:
        from scipy.optimize import linear_sum_assignment  # slow to import, seldom needed
        from scipy.spatial.distance import cdist

        # Each point's sorted distances to the others know nothing of names.
        cost = cdist(np.sort(Dr), np.sort(Dm), "sqeuclidean")
        candidates = linear_sum_assignment(cost)[1][None, :]
    worst = np.array([np.abs(Dm[np.ix_(c, c)] - Dr).max() for c in candidates])
    fits = [k for k in np.argsort(worst, kind="stable") if worst[k] <= 5 * np.sqrt(2) * sigma]
    orders = [candidates[k] for k in fits if np.any(candidates[k] != np.arange(count))]
    turned = [x @ so3.project(y[c].T @ x).T for c in orders]
    gaps = [np.linalg.norm(y[c] - t, axis=1).max() for c, t in zip(orders, turned, strict=True)]
    return [c for c, gap in zip(orders, gaps, strict=True) if gap <= 5 * np.sqrt(3) * sigma]


def describe_relabelling(labels: tuple[str, ...], order: IntArray) -> str:
    """In words: which measured point would have to bear which name."""
    moved = [(labels[k], labels[j]) for j, k in enumerate(order) if j != k]
    return ", ".join(f"{old} is {new}" for old, new in moved)


def _distances(xyz: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(xyz[:, None] - xyz, axis=2))


def _listed(names: tuple[str, ...]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
