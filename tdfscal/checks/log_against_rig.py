"""Do the log and the rig file speak of the same machine? Units, axes, signs, names, wiring.

These checks come before any estimate: a mislabelled log must not become a plausible calibration.
Other ways to name the channels are: supports, axes and single channels exchanged, signs. What only
turns a sensor's axes, or those of all positions, is not among them: the one is a mounting, the
other another base frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, permutations, product
from typing import Final

import numpy as np

from tdfscal.checks import geometry
from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, gravity, nominal
from tdfscal.model.postures import register
from tdfscal.model.statics import Postures, forces
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig

#: Supports above which only the same axes of two sensors are exchanged.
_MANY: Final = 8
#: Axes of positions, and of forces with whose they are where they are every sensor's.
_PLACES: Final = ("X", "Y", "Z")
_FORCES: Final = ("Fx", "Fy", "Fz")
_EVERYONE: Final = "every sensor"
#: Words of the wiring in which every sensor records the reaction.
REACTION: Final = f"the opposite sign of every axis of {_EVERYONE}"


@record
class Wiring:
    """What each channel is to be read from: source (n, 3), numbered 3 i + a, times sign (n, 3)."""

    words: str
    source: IntArray
    sign: FloatArray

    def turned(self, supports: tuple[str, ...]) -> dict[str, Value]:
        """Whose axes have the opposite sign, and each axis' own; nothing of an exchange."""
        which = np.flatnonzero((self.sign < 0).any(axis=1))
        if not len(which) or np.any(np.diff(self.source.ravel()) != 1):
            return {}
        whose = supports[which[0]] if len(which) == 1 else "<each>"
        return {"turned": whose, "signs": self.sign[which[0]].tolist()}

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


def exchanged_supports(supports: tuple[str, ...], what: str = "the positions") -> Iterator[Wiring]:
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
    for name in (*supports, _EVERYONE):
        yield from _rewired_axes(supports, name, _FORCES)


def rewired_positions(supports: tuple[str, ...]) -> Iterator[Wiring]:
    """Positioners exchanged; axes of one, or of all, exchanged, or of opposite sign."""
    yield from exchanged_supports(supports)
    yield from mirrored_frames(len(supports))
    for name in supports:
        yield from _rewired_axes(supports, name, _PLACES)
    yield from exchanged_channels(supports, np.ones((len(supports), 3), dtype=np.bool_), _PLACES)


def _rewired_axes(
    supports: tuple[str, ...], name: str, axes: tuple[str, str, str]
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


#: Positions and rig file must agree in size within this share.
_SIZE = 0.02
#: Forces and weight must agree within this share; the fit judges the rest far more sharply.
_WEIGHT = 0.2
#: Forces a thousand times too small may be rounded by up to this factor.
_COARSELY = 2.0
#: Forces below this share of the weight carry no terminal.
_TINY = 0.01
#: Units of length, m: those that a rig file can declare, and others that a recorder may write.
_DECLARED = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_FOREIGN = {"cm": 1e-2, "inches": 0.0254}
#: A terminal turned further than this from the BCS hints at exchanged names, rad.
_TURNED = np.pi / 4
#: Units of force, with the one declared, by what they make of a reading.
UNITS = {1e3: ("N", "kN"), 1e-3: ("kN", "N"), 1 / 9.80665: ("kgf", ""), 1 / 4.4482216: ("lbf", "")}


def check_geometry(rig: Rig, position: FloatArray, force: FloatArray) -> None:
    """Refuse positions with which no fit can be trusted; what is smaller is for `geometry`.

    position : (K, n, 3), m, BCS. force : (K, n, 3), N, readings, for what declared supports give.

    Raises
    ------
    DataError
        The distances between hinges are far from the rig file's, or the terminal stands on its
        head while gravity points along −Z: a unit, swapped or mirrored axes, swapped supports, a
        hinge or a positioner's offset, or another rig.
    """
    limit = geometry.gross_limit(rig, force)
    off, up = geometry.misfit(rig.hinge, position)
    if off <= limit and up > 0:
        check_size(rig, position)
        return
    facts = _explanation(rig, position, limit) | _farthest(rig, position)
    misplaced = [] if facts["fits"] or off <= limit else _misplaced(rig, position)
    if not (facts["fits"] or misplaced):
        check_size(rig, position)
    if off <= limit:
        raise DataError(Finding("terminal-overturned", values=facts))
    for cause in reversed(misplaced):
        facts["hinge" if cause.kind == "hinge" else "servo"] = rig.supports[cause.support or 0]
        facts |= {
            "by": float(np.linalg.norm(cause.amount)),
            "more": bool(np.isinf(cause.std).any()),
            "either": "hinge" in facts,
        }
    raise DataError(Finding("hinges-off", size=off, unit="m", values=facts))


def _misplaced(rig: Rig, position: FloatArray) -> list[geometry.Cause]:
    """The hinges or positioners one of which explains the distances, the likeliest first."""
    found = geometry.examine(rig, position, np.full(len(position), rig.declared.positioner**2))
    told = found.explained and found.causes and found.causes[0].support is not None
    return [cause for cause in found.causes if told and cause.support is not None]


def _farthest(rig: Rig, position: FloatArray) -> dict[str, Value]:
    """The two hinges whose distance in the log, position (K, n, 3), differs most from rig's."""
    first, second = np.triu_indices(rig.n, 1)
    logged = np.median(np.linalg.norm(position[:, first] - position[:, second], axis=2), axis=0)
    stated = np.linalg.norm(rig.hinge[first] - rig.hinge[second], axis=1)
    k = int(np.argmax(np.abs(logged - stated)))
    names = {"first": rig.supports[first[k]], "second": rig.supports[second[k]]}
    return {**names, "logged": float(logged[k]), "stated_m": float(stated[k])}


def check_size(rig: Rig, position: FloatArray) -> None:
    """Raise DataError where positions (K, n, 3) cannot be in the unit that is declared."""
    p = position - position.mean(axis=1, keepdims=True)
    r = rig.hinge - rig.hinge.mean(axis=0)
    size = float(np.median(np.sqrt(np.sum(p**2, axis=(1, 2)) / np.sum(r**2))))
    if abs(size - 1) <= _SIZE:
        return
    facts: dict[str, Value] = {}
    for name, table in (("declared", _DECLARED), ("foreign", _FOREIGN)):
        if units := _units(size, table):
            facts = {"units": ", or ".join(units), "foreign": name == "foreign"}
            break
    raise DataError(Finding("lengths-rescaled", size=size, values=facts))


def _units(size: float, table: dict[str, float]) -> list[str]:
    """Units that make lengths wrong by this factor.

    What is declared is not known here: each is named with the unit that it was taken for.
    """
    return [
        f"in {own} where {stated} is declared"
        for stated, declared in _DECLARED.items()
        for own, metres in table.items()
        if abs(size * metres / declared - 1) < _SIZE
    ]


def turned(rig: Rig, position: FloatArray) -> tuple[Finding, ...]:
    """Say where the terminal stands far from the BCS's axes; position (K, n, 3) in m.

    On a symmetric rig, supports renamed in a circle look like a terminal that is turned: nothing
    contradicts it, so that it can only be said.
    """
    turn = _turn(rig, position)
    angle = float(np.linalg.norm(turn))
    if angle <= _TURNED:
        return ()
    R, _ = register(rig.hinge, position)
    always = bool(np.linalg.norm(so3.log(R), axis=1).min() > _TURNED)
    about = turn / angle
    axis = int(np.argmax(np.abs(about)))
    sign = "-" if about[axis] < 0 else ""
    clear = abs(about[axis]) > np.cos(_TURNED / 2)
    values: dict[str, Value] = {"always": always}
    if clear:
        values["axis"] = f"{sign}{'XYZ'[axis]}"
    limit, upright = geometry.gross_limit(rig), []
    for other in exchanged_supports(rig.supports, ""):
        place = other.signals(position)
        off, up = geometry.misfit(rig.hinge, place)
        left = float(np.linalg.norm(_turn(rig, place)))
        if off <= limit and up > 0 and left <= _TURNED:
            upright.append((left, other.words.removeprefix(" of ")))
    if upright:
        values["upright"] = min(upright)[1]
    return (Finding("terminal-turned", size=angle, unit="rad", values=values),)


def _turn(rig: Rig, position: FloatArray) -> FloatArray:
    """Rotation vector (3,), rad, of the terminal's middle orientation over the postures."""
    R, _ = register(rig.hinge, position)
    return np.asarray(so3.log(so3.project(R.mean(axis=0))))


def _explanation(rig: Rig, position: FloatArray, limit: float) -> dict[str, Value]:
    """The rearrangement that fits upright with the terminal least turned: words and signs."""
    fitting = {}
    for other in rewired_positions(rig.supports):
        place = other.signals(position)
        off, up = geometry.misfit(rig.hinge, place)
        if off <= limit and up > 0:
            turn = so3.log(register(rig.hinge, place)[0])
            fitting[float(np.median(np.linalg.norm(turn, axis=1))), other.words] = other
    best = fitting[min(fitting)] if fitting else None
    return {"fits": None} if best is None else {"fits": best.words, **best.turned(rig.supports)}


def check_weight(rig: Rig, postures: Postures, state: State) -> None:
    """Compare the sum of the forces at a state's mounting with the weight.

    Raises
    ------
    DataError
        A unit, a sign, or another mounting.
    """
    ratio = float(np.median(weight_share(state, rig.gravity, postures.force)))
    allowed = weight_tolerance(float(rig.mass.std) / float(rig.mass.value))
    if abs(ratio - 1) > allowed:
        raise weight_error(ratio, allowed, float(rig.mass.value))


def check_unit(rig: Rig, force: FloatArray) -> None:
    """Look whether readings (K, n, 3), N, are a thousand times too large or too small.

    Asked before a channel is called dead: in the wrong unit, with few digits, it does not move;
    and before a load is said to have changed.

    Raises
    ------
    DataError
        kN where N is declared, or the other way round.
    """
    mass = float(rig.mass.value)
    measured, state = np.where(rig.axes, force, 0.0), nominal(rig)
    held = float(np.median(np.linalg.norm(measured, axis=2).sum(axis=1)))
    if held < _TINY * mass * rig.gravity:  # zeros in N would hide what little there is
        state = replace(state, zero=np.zeros_like(state.zero))
    ratio = float(np.median(weight_share(state, rig.gravity, measured)))
    for factor, unit in UNITS.items():
        if abs(np.log10(factor)) >= 3 and 1 / _COARSELY < abs(ratio) / factor < _COARSELY:
            raise DataError(_rescaled(ratio, mass, unit))


def weight_share(state: State, g: float, force: FloatArray) -> FloatArray:
    """Part (K,) of the weight that the readings (K, n, 3), N, hold up: 1 at rest, untouched."""
    weight = state.mass * gravity(state, g)
    total = forces(state, force).sum(axis=1)
    return np.asarray(-(total @ weight) / (weight @ weight))


def weight_tolerance(relative: float) -> float:
    """How far that part may be from 1; relative : standard uncertainty of the mass."""
    return _WEIGHT + 6 * relative


def unit_of(ratio: float) -> tuple[str, str]:
    """The unit, and the one declared, that makes of forces so many times what they should be."""
    near = (unit for f, unit in UNITS.items() if abs(abs(ratio) / f - 1) < _WEIGHT)
    return next(near, ("", ""))


def weight_error(ratio: float, allowed: float, mass: float) -> DataError:
    """The error for forces that sum to `ratio` times the weight of `mass`, kg."""
    if abs(ratio + 1) <= allowed:
        return DataError(Finding("reaction-recorded"))
    return DataError(_rescaled(ratio, mass, unit_of(ratio)))


def _rescaled(ratio: float, mass: float, unit: tuple[str, str]) -> Finding:
    facts: dict[str, Value] = {"mass": mass, "unit": unit[0], "declared": unit[1]}
    return Finding("forces-rescaled", size=ratio, values=facts)
