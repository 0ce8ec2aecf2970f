"""Which measured point is which reference point: by name, and checked by the distances."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.optimize import linear_sum_assignment

from tdfscal.errors import DataError
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray, PointSet

_ALL_PERMUTATIONS_UP_TO = 6  # 720; beyond it, points are told apart by their sorted distances
_UNITS = {"mm read as m": 1000.0, "inches read as mm": 25.4, "inches read as m": 1000 / 25.4}
_UNITS |= {"µm read as mm": 1000.0, "µm read as m": 1e6}


@dataclass(frozen=True, slots=True)
class MatchedPoints:
    """Points that two sets have in common, in the reference set's order.

    group, point : names, (N,). measured, reference : (N, 3), m, each in its own frame.
    measured_std, reference_std : (N, 3), m, as the files state; zeros where they state none.
    missing : "group/point" of the reference that were not measured. extra : the reverse.
    """

    group: tuple[str, ...]
    point: tuple[str, ...]
    measured: FloatArray
    reference: FloatArray
    measured_std: FloatArray
    reference_std: FloatArray
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    source: str

    def __len__(self) -> int:
        return len(self.group)

    @property
    def names(self) -> tuple[str, ...]:
        """Return "group/point" of each point."""
        return tuple(f"{g}/{p}" for g, p in zip(self.group, self.point, strict=True))

    def take(self, which: IntArray) -> MatchedPoints:
        """Only the points with these indices; missing and extra ones are left as they are."""
        return MatchedPoints(
            tuple(self.group[i] for i in which),
            tuple(self.point[i] for i in which),
            self.measured[which],
            self.reference[which],
            self.measured_std[which],
            self.reference_std[which],
            self.missing,
            self.extra,
            self.source,
        )

    def indices(self, group: str) -> IntArray:
        """Where the points of one group are."""
        return np.flatnonzero([g == group for g in self.group])


def match_points(measured: PointSet, reference: PointSet) -> MatchedPoints:
    """Pair the points of two sets by group and point name.

    Raises
    ------
    DataError : no name is common to both.
    """
    where = {name: i for i, name in enumerate(zip(measured.group, measured.point, strict=True))}
    names = list(zip(reference.group, reference.point, strict=True))
    common = [(j, where[name]) for j, name in enumerate(names) if name in where]
    if not common:
        ours, theirs = (
            _listed([f"{g}/{p}" for g, p in where]),
            _listed([f"{g}/{p}" for g, p in names]),
        )
        raise DataError(
            f"no point has the same group and name as one of {reference.source}: {ours} against "
            f"{theirs}",
            where=measured.source,
            hint="give the same points the same group and name in both files",
        )
    j, i = (np.array(index) for index in zip(*common, strict=True))
    known = set(names)
    return MatchedPoints(
        group=tuple(reference.group[k] for k in j),
        point=tuple(reference.point[k] for k in j),
        measured=measured.xyz[i],
        reference=reference.xyz[j],
        measured_std=np.zeros((len(i), 3)) if measured.std is None else measured.std[i],
        reference_std=np.zeros((len(j), 3)) if reference.std is None else reference.std[j],
        missing=tuple(f"{g}/{p}" for g, p in names if (g, p) not in where),
        extra=tuple(f"{g}/{p}" for g, p in where if (g, p) not in known),
        source=measured.source,
    )


def describe_unmatched(points: MatchedPoints) -> tuple[str, ...]:
    """One sentence each for the missing and the extra points, if any."""
    lines = []
    if points.missing:
        lines.append(f"{points.source}: not measured: {_listed(points.missing)}")
    if points.extra:
        lines.append(f"{points.source}: measured, but without reference: {_listed(points.extra)}")
    return tuple(lines)


def unit_mistake(measured: FloatArray, reference: FloatArray) -> str | None:
    """What a ratio of the two sets' sizes far from one looks like, in words.

    measured, reference : (N, 3), m. The size is the rms distance from the centroid, which no
    permutation of the points changes.
    """
    size = [
        np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))) for p in (measured, reference)
    ]
    if min(size) == 0:
        return None
    ratio = float(size[0] / size[1])
    if 0.95 < ratio < 1.05:
        return None
    for text, factor in _UNITS.items():
        for name, r in (("measured", ratio), ("reference", 1 / ratio)):
            if abs(r / factor - 1) < 0.02:
                return f"the {name} points are {r:.4g} times as large as the others: {text}?"
    return None


def same_distances(measured: FloatArray, reference: FloatArray, sigma: float) -> bool:
    """Whether all distances within (N, 3) and (N, 3), m, agree within 5 √2 sigma."""
    gap = np.abs(_distances(measured) - _distances(reference))
    return bool(gap.max() <= 5 * np.sqrt(2) * sigma)


def relabellings(measured: FloatArray, reference: FloatArray, sigma: float) -> list[IntArray]:
    """Permutations π, but the identity, under which measured[π] has the distances of reference.

    measured, reference : (N, 3), m. sigma : m, standard uncertainty of a coordinate difference;
    distances agree within 5 √2 sigma, and a rotation (not only a reflection) brings the points to
    within 5 √3 sigma. Best first.
    """
    count = len(measured)
    Dm, Dr = _distances(measured), _distances(reference)
    if count <= _ALL_PERMUTATIONS_UP_TO:
        candidates = np.array(list(permutations(range(count))))
    else:
        # Each point's sorted distances to the others know nothing of names.
        cost = np.sum((np.sort(Dr)[:, None, :] - np.sort(Dm)[None, :, :]) ** 2, axis=-1)
        candidates = linear_sum_assignment(cost)[1][None, :]
    worst = np.array([np.abs(Dm[np.ix_(c, c)] - Dr).max() for c in candidates])
    fits = [k for k in np.argsort(worst, kind="stable") if worst[k] <= 5 * np.sqrt(2) * sigma]
    orders = [candidates[k] for k in fits if np.any(candidates[k] != np.arange(count))]
    return [c for c in orders if _rigid_gap(measured[c], reference) <= 5 * np.sqrt(3) * sigma]


def describe_relabelling(labels: tuple[str, ...], order: IntArray) -> str:
    """In words: which measured point would have to bear which name."""
    moved = [(labels[k], labels[j]) for j, k in enumerate(order) if j != k]
    return ", ".join(f"{old} is {new}" for old, new in moved)


def _rigid_gap(measured: FloatArray, reference: FloatArray) -> float:
    """Largest distance left after the best rotation by SVD, m."""
    y, x = measured - measured.mean(axis=0), reference - reference.mean(axis=0)
    return float(np.linalg.norm(y - x @ so3.project(y.T @ x).T, axis=1).max())


def _distances(xyz: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(xyz[:, None] - xyz[None, :], axis=-1))


def _listed(names: tuple[str, ...] | list[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
