"""Ways in which channels are read in each other's place, with the opposite sign, in another unit.

Supports, axes and single channels exchanged, signs, and for forces two of these at once. What only
turns a sensor's axes is not among them: that is a mounting. Nor is what only turns the axes of all
positions about the vertical: that is another base frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, permutations, product
from typing import Final

import numpy as np

from tdfscal.findings import Value
from tdfscal.frozen import record, replace
from tdfscal.model.statics import Postures
from tdfscal.records import BoolArray, FloatArray, IntArray

#: Supports above which only the same axes of two sensors are exchanged, or of opposite sign.
_MANY: Final = 8
#: Supports up to which all orders are tried, and all pairs of mistakes.
_FEW: Final = 4
#: Cosine of the angle by which a sensor that was turned by quarter turns may be turned besides.
_QUARTERLY: Final = np.cos(np.pi / 8)
#: Axes of positions, and of forces with whose they are where they are every sensor's.
_PLACES: Final = ("X", "Y", "Z")
_FORCES: Final = ("Fx", "Fy", "Fz")
_EVERYONE: Final = "every sensor"
#: Units of positions beside the others', by what brings them to it.
_UNITS: Final = {1e3: "times 1000, as m among mm", 1e-3: "divided by 1000, as mm among m"}
#: Words of the wiring in which every sensor records the reaction.
REACTION: Final = f"the opposite sign of every axis of {_EVERYONE}"


@record
class Wiring:
    """What each channel is to be read from: source (n, 3), numbered 3 i + a, times sign (n, 3).

    The sign of a channel of another unit is a factor.
    """

    words: str
    source: IntArray
    sign: FloatArray

    @property
    def supports(self) -> IntArray:
        """Those whose channels are read from elsewhere, or of opposite sign."""
        other = self.source != np.arange(self.source.size).reshape(-1, 3)
        return np.flatnonzero((other | (self.sign < 0)).any(axis=1))

    @property
    def whole(self) -> bool:
        """Whether only whole supports are exchanged."""
        same = np.arange(3) == self.source % 3
        return bool(same.all() and (self.sign > 0).all() and not np.ptp(self.source // 3, 1).any())

    @property
    def mounting(self) -> bool:
        """Whether it only turns sensors, so that another mounting would look alike."""
        axes = np.eye(3)[self.source % 3] * self.sign[..., None]
        own = self.source // 3 == np.arange(len(self.source))[:, None]
        return bool(own.all() and np.all(np.linalg.det(axes) > 0))

    @property
    def mirror(self) -> bool:
        """Whether one axis of all is of opposite sign, as in a left-handed log."""
        own = np.arange(self.source.size).reshape(-1, 3)
        one = np.array_equal(np.sort(self.sign[0]), [-1, 1, 1])
        return bool(one and np.all(self.sign == self.sign[0]) and np.all(self.source == own))

    def then(self, other: Wiring) -> Wiring:
        """Both: the other one is of channels that are read by this one."""
        sign = other.sign * self.sign.ravel()[other.source]
        return Wiring(f"{self.words}, and {other.words}", self.source.ravel()[other.source], sign)

    def written(self, supports: tuple[str, ...]) -> dict[str, Value]:
        """Who is read from elsewhere, the channels of each; whose axes are to be multiplied, and
        by what each.
        """
        own = np.arange(self.source.size).reshape(-1, 3)
        moved, turned = (self.source != own).any(axis=1), (self.sign != 1).any(axis=1)
        values: dict[str, Value] = {}
        if moved.any():
            values["moved"] = [supports[k] for k in np.flatnonzero(moved)]
            values["sources"] = self.source[moved].ravel().tolist()
        if turned.all() and np.all(self.sign == self.sign[0]):
            values |= {"turned": ["<each>"], "signs": self.sign[0].tolist()}
        elif turned.any():
            values["turned"] = [supports[k] for k in np.flatnonzero(turned)]
            values["signs"] = self.sign[turned].ravel().tolist()
        return values

    def signals(self, value: FloatArray) -> FloatArray:
        """Positions or forces (..., n, 3) as they would be."""
        flat = value.reshape(*value.shape[:-2], -1)
        return np.asarray(self.sign * flat[..., self.source])

    def postures(self, seen: Postures) -> Postures:
        """Postures with forces as they would be; the readings of two sensors do not correlate."""
        return replace(seen, force=self.signals(seen.force), force_cov=self._cov(seen.force_cov))

    def positions(self, seen: Postures) -> Postures:
        """Postures with positions as they would be."""
        place, cov = self.signals(seen.position), self._cov(seen.position_cov)
        return replace(seen, position=place, position_cov=cov)

    def _cov(self, cov: FloatArray) -> FloatArray:
        sensor, axis = np.divmod(self.source, 3)
        sign = self.sign[:, :, None] * self.sign[:, None]
        sign = sign * (sensor[:, :, None] == sensor[:, None])
        return np.asarray(sign * cov[:, sensor[:, :, None], axis[:, :, None], axis[:, None]])


def exchanged_supports(supports: tuple[str, ...], what: str = "the positions") -> Iterator[Wiring]:
    """Supports exchanged: in every order for up to four, two by two beyond.

    what : that is theirs, in words.
    """
    n = len(supports)
    if n <= _FEW:
        orders = list(permutations(range(n)))[1:]
    else:
        swap = [{i: j, j: i} for i, j in combinations(range(n), 2)]
        orders = [tuple(each.get(i, i) for i in range(n)) for each in swap]
    for order in orders:
        moved = [f"{supports[i]} taken from {supports[j]}" for i, j in enumerate(order) if i != j]
        source = 3 * np.array(order)[:, None] + np.arange(3)
        yield Wiring(f"{what} of {' and '.join(moved)}", source, np.ones((n, 3)))


def frames(n: int) -> Iterator[Wiring]:
    """Axes of all n supports read as others, so that the frame is left-handed, or Z no vertical."""
    for axes, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        upright = axes[2] == 2 and signs[2] > 0
        if np.linalg.det(np.eye(3)[list(axes)] * np.array(signs)) < 0 or not upright:
            names = [f"{'-' if s < 0 else ''}{'XYZ'[a]}" for a, s in zip(axes, signs, strict=True)]
            source = 3 * np.arange(n)[:, None] + np.array(axes)
            way = Wiring(f"the axes read as {', '.join(names)}", source, np.tile(signs, (n, 1)))
            if way.mirror:
                turned = _PLACES[signs.index(-1.0)]
                words = f"the opposite sign of {turned} of every positioner, the log left-handed"
                way = replace(way, words=words)
            yield way


def rewired_positions(supports: tuple[str, ...]) -> Iterator[Wiring]:
    """Positioners exchanged; axes of all exchanged, or of opposite sign; `bent_positions`."""
    yield from exchanged_supports(supports)
    yield from frames(len(supports))
    yield from bent_positions(supports)


def bent_positions(supports: tuple[str, ...]) -> Iterator[Wiring]:
    """What no rigid terminal would look like: axes of one positioner exchanged, of opposite sign or
    another unit; channels of two exchanged.
    """
    for name in supports:
        yield from rewired_axes(supports, name, _PLACES)
        for factor, words in _UNITS.items():
            for which, axes in (*zip(_PLACES, np.eye(3), strict=True), ("every axis", np.ones(3))):
                own = np.array([name == support for support in supports])[:, None]
                sign, same = np.where(own & (axes > 0), factor, 1.0), np.arange(3 * len(supports))
                yield Wiring(f"{which} of {name} {words}", same.reshape(-1, 3), sign)
    yield from exchanged_channels(supports, np.ones((len(supports), 3), dtype=np.bool_), _PLACES)


def rewired_sensors(supports: tuple[str, ...]) -> Iterator[Wiring]:
    """Sensors exchanged; two axes of a sensor, or of all, exchanged, or of opposite sign."""
    yield from exchanged_supports(supports, "the sensors")
    for name in (*supports, _EVERYONE):
        yield from rewired_axes(supports, name)


def rewired_forces(supports: tuple[str, ...], measured: BoolArray) -> Iterator[Wiring]:
    """One mistake, or two: signs of two sensors, or an exchange and signs of one whom it moves.

    measured : (n, 3), channels that may be exchanged.
    """
    yield from rewired_sensors(supports)
    channels = list(exchanged_channels(supports, measured))
    yield from channels
    n = len(supports)
    if n > _MANY:
        return
    signs = [list(rewired_axes(supports, name))[3:] for name in (*supports, _EVERYONE)]
    for i, j in combinations(range(n), 2):
        yield from (one.then(other) for one, other in product(signs[i], signs[j]))
    orders = list(exchanged_supports(supports, "the sensors"))
    for exchange in orders if n > _FEW else (*orders, *channels):
        for i in (*exchange.supports, n):
            yield from (exchange.then(other) for other in signs[i])


def rewired_axes(
    supports: tuple[str, ...], name: str, axes: tuple[str, str, str] = _FORCES
) -> Iterator[Wiring]:
    """Two axes of a support, or of every sensor, exchanged, or of opposite sign."""
    same = np.arange(3 * len(supports)).reshape(-1, 3)
    own = np.array([name in (support, _EVERYONE) for support in supports])[:, None]
    for a, b in combinations(range(3), 2):
        order = np.arange(3)
        order[[a, b]] = b, a
        words = f"{axes[a]} and {axes[b]} of {name} exchanged"
        yield Wiring(words, np.where(own, same[:, order], same), np.ones(same.shape))
    for turned, which in (*(([a], axes[a]) for a in range(3)), ([0, 1, 2], "every axis")):
        sign = np.where(own & np.isin(np.arange(3), turned), -1.0, 1.0)
        yield Wiring(f"the opposite sign of {which} of {name}", same, sign)


def turned_axes(supports: tuple[str, ...], turns: FloatArray) -> Wiring | None:
    """The axes of each sensor's readings that are what turns (n, 3, 3) make of them.

    None where no sensor is turned by quarter turns, or one by anything else.
    """
    n, axis = len(supports), np.abs(turns).argmax(axis=2)
    along = np.take_along_axis(turns, axis[..., None], axis=2)[..., 0]
    if np.any(np.sort(axis) != np.arange(3)) or np.abs(along).min() < _QUARTERLY:
        return None
    sign = np.sign(along)
    words = []
    for name, order, own in zip(supports, axis, sign, strict=True):
        read = [f"{'-' if s < 0 else ''}{'XYZ'[a]}" for a, s in zip(order, own, strict=True)]
        opposite = " and ".join(_FORCES[a] for a in np.flatnonzero(own < 0))
        if np.any(order != np.arange(3)):
            words.append(f"the axes of {name} read as {', '.join(read)}")
        elif opposite:
            words.append(f"the opposite sign of {opposite} of {name}")
    found = Wiring(", and ".join(words), 3 * np.arange(n)[:, None] + axis, sign)
    return found if words else None


def exchanged_channels(
    supports: tuple[str, ...], measured: BoolArray, axes: tuple[str, str, str] = _FORCES
) -> Iterator[Wiring]:
    """Two channels of different supports exchanged, of those that are measured (n, 3).

    Of many supports only the same axes: cables of one kind are mistaken for each other.
    """
    n = len(supports)
    for (i, a), (j, b) in combinations(np.argwhere(measured).tolist(), 2):
        if i == j or (a != b and n > _MANY):
            continue
        source = np.arange(3 * n).reshape(-1, 3)
        source[i, a], source[j, b] = 3 * j + b, 3 * i + a
        names = f"{axes[a]} of {supports[i]} and {axes[b]} of {supports[j]}"
        yield Wiring(f"{names} exchanged", source, np.ones((n, 3)))
