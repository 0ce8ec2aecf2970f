"""Cables and fields exchanged: a log as it would read with names put otherwise, in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np

from tdfscal.model.statics import Postures
from tdfscal.records import FloatArray, Rig

#: Sensors above which not every pair of channels is exchanged.
_MANY = 8
#: How the readings of the reaction are named, with a place for whose.
REACTION = "the opposite sign of every axis of {}"
#: Whose, where it is every sensor's.
EVERYONE = "every sensor"


def orders(n: int) -> Iterator[list[int]]:
    """Ways to exchange supports other than the given one: all for up to four, pairs beyond."""
    if n <= 4:
        yield from (list(p) for p in permutations(range(n)) if list(p) != list(range(n)))
        return
    for i in range(n):
        for j in range(i):
            order = list(range(n))
            order[i], order[j] = j, i
            yield order


def rewired(rig: Rig, seen: Postures) -> Iterator[tuple[str, Postures]]:
    """Postures as they would be with the forces' fields named otherwise, each with its words.

    Sensors exchanged; two axes of a sensor, or of all, exchanged, or one of opposite sign. What
    only turns a sensor's axes is not among them: that is a mounting.
    """
    for order in orders(rig.n):
        yield (
            f"the sensors of {renamed(rig, order)}",
            replace(seen, force=seen.force[:, order], force_cov=seen.force_cov[:, order]),
        )
    for name in (*rig.supports, EVERYONE):
        here = np.array([name in (support, EVERYONE) for support in rig.supports])
        for words, mirror in _mirrors():
            M = np.where(here[:, None, None], mirror, np.eye(3))
            yield (
                words.format(name),
                replace(
                    seen,
                    force=(M @ seen.force[..., None])[..., 0],
                    force_cov=M @ seen.force_cov @ np.swapaxes(M, 1, 2),
                ),
            )


def channels_exchanged(rig: Rig, seen: Postures) -> Iterator[tuple[str, Postures]]:
    """Postures with two channels of different sensors exchanged, each with its words.

    Of many sensors only the same axes: cables of one kind are mistaken for each other.
    """
    some = np.argwhere(rig.axes)
    for (i, a), (j, b) in combinations(some.tolist(), 2):
        if i == j or (a != b and rig.n > _MANY):
            continue
        force, cov = seen.force.copy(), seen.force_cov.copy()
        force[:, i, a], force[:, j, b] = seen.force[:, j, b], seen.force[:, i, a]
        cov[:, i, a, a], cov[:, j, b, b] = seen.force_cov[:, j, b, b], seen.force_cov[:, i, a, a]
        yield (
            f"F{'xyz'[a]} of {rig.supports[i]} and F{'xyz'[b]} of {rig.supports[j]} exchanged",
            replace(seen, force=force, force_cov=cov),
        )


def _mirrors() -> Iterator[tuple[str, FloatArray]]:
    """Axes exchanged or of opposite sign, as words with a place for whose, and matrices (3, 3)."""
    eye = np.eye(3)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        order = list(range(3))
        order[a], order[b] = b, a
        yield f"F{'xyz'[a]} and F{'xyz'[b]} of {{}} exchanged", eye[order]
    for a in range(3):
        yield (
            f"the opposite sign of F{'xyz'[a]} of {{}}",
            eye * np.where(np.arange(3) == a, -1.0, 1.0),
        )
    yield REACTION, -eye


def renamed(rig: Rig, order: list[int]) -> str:
    """Words for an exchange of supports."""
    moved = [
        f"{rig.supports[i]} taken from {rig.supports[j]}" for i, j in enumerate(order) if i != j
    ]
    return " and ".join(moved)
