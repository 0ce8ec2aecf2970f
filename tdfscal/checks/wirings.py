"""Other ways to name the channels of a log: supports, axes and single channels exchanged, signs.

What only turns a sensor's axes, or those of all positions, is not among them: the one is a
mounting, the other another base frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, permutations, product
from typing import Final

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.model.statics import Postures
from tdfscal.records import FloatArray, IntArray, Rig

#: Supports above which only the same axes of two sensors are exchanged.
_MANY: Final = 8
#: Whose, where it is every sensor's.
_EVERYONE: Final = "every sensor"
#: Words of the wiring in which every sensor records the reaction.
REACTION: Final = f"the opposite sign of every axis of {_EVERYONE}"


@record
class Wiring:
    """What each channel is to be read from: source (n, 3), numbered 3 i + a, times sign (n, 3)."""

    words: str
    source: IntArray
    sign: FloatArray

    def signals(self, value: FloatArray) -> FloatArray:
        """Positions or forces (..., n, 3) as they would be."""
        flat = value.reshape(*value.shape[:-2], -1)
        return np.asarray(self.sign * flat[..., self.source])

    def postures(self, seen: Postures) -> Postures:
        """Postures as they would be; the readings of two sensors are not correlated."""
        sensor, axis = np.divmod(self.source, 3)
        sign = self.sign[:, :, None] * self.sign[:, None]
        sign = sign * (sensor[:, :, None] == sensor[:, None])
        cov = seen.force_cov[:, sensor[:, :, None], axis[:, :, None], axis[:, None]]
        return replace(seen, force=self.signals(seen.force), force_cov=sign * cov)


def exchanged_supports(supports: tuple[str, ...], what: str) -> Iterator[Wiring]:
    """Supports exchanged: in every order for up to four, two by two beyond.

    what : that is theirs, in words.
    """
    n = len(supports)
    orders = [list(order) for order in permutations(range(n))][1:] if n <= 4 else []
    for i, j in product(range(n), repeat=2) if n > 4 else ():
        if j < i:
            orders.append(list(range(n)))
            orders[-1][i], orders[-1][j] = j, i
    for order in orders:
        moved = [f"{supports[i]} taken from {supports[j]}" for i, j in enumerate(order) if i != j]
        source = 3 * np.array(order)[:, None] + np.arange(3)
        yield Wiring(f"{what} of {' and '.join(moved)}", source, np.ones((n, 3)))


def mirrored_frames(n: int) -> Iterator[Wiring]:
    """Axes of all n supports exchanged or of opposite sign, so that the frame is left-handed."""
    for axes, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if np.linalg.det(np.eye(3)[list(axes)] * np.array(signs)) < 0:
            names = [f"{'-' if s < 0 else ''}{'XYZ'[a]}" for a, s in zip(axes, signs, strict=True)]
            source = 3 * np.arange(n)[:, None] + np.array(axes)
            yield Wiring(f"the axes read as {', '.join(names)}", source, np.tile(signs, (n, 1)))


def rewired_sensors(supports: tuple[str, ...]) -> Iterator[Wiring]:
    """Sensors exchanged; two axes of a sensor, or of all, exchanged, or of opposite sign."""
    yield from exchanged_supports(supports, "the sensors")
    n, same = len(supports), 3 * np.arange(len(supports))[:, None] + np.arange(3)
    for name in (*supports, _EVERYONE):
        own = np.array([name in (support, _EVERYONE) for support in supports])[:, None]
        for a, b in combinations(range(3), 2):
            order = np.arange(3)
            order[[a, b]] = b, a
            words = f"F{'xyz'[a]} and F{'xyz'[b]} of {name} exchanged"
            yield Wiring(words, np.where(own, same[:, order], same), np.ones((n, 3)))
        for axes in ([0], [1], [2], [0, 1, 2]):
            which = f"F{'xyz'[axes[0]]}" if len(axes) == 1 else "every axis"
            sign = np.where(own & np.isin(np.arange(3), axes), -1.0, 1.0)
            yield Wiring(f"the opposite sign of {which} of {name}", same, sign)


def exchanged_channels(rig: Rig) -> Iterator[Wiring]:
    """Two channels of different sensors exchanged.

    Of many sensors only the same axes: cables of one kind are mistaken for each other.
    """
    for (i, a), (j, b) in combinations(np.argwhere(rig.axes).tolist(), 2):
        if i == j or (a != b and rig.n > _MANY):
            continue
        source = np.arange(3 * rig.n).reshape(-1, 3)
        source[i, a], source[j, b] = 3 * j + b, 3 * i + a
        names = f"F{'xyz'[a]} of {rig.supports[i]} and F{'xyz'[b]} of {rig.supports[j]}"
        yield Wiring(f"{names} exchanged", source, np.ones((rig.n, 3)))
