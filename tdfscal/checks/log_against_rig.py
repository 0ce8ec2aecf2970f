"""Do the log and the rig file speak of the same machine? Units, axes, signs, names, wiring.

These checks come before any estimate: a mislabelled log must not become a plausible calibration.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from tdfscal.checks import geometry
from tdfscal.checks.geometry import CODES
from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import replace
from tdfscal.model.parameters import State, gravity, nominal
from tdfscal.model.postures import mean_shape, register
from tdfscal.model.statics import Postures, forces
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig

if TYPE_CHECKING:
    from tdfscal.checks.wiring import Wiring

#: Share of the size beyond which positions are of another machine, or misnamed.
_SHAPE = 2e-3
#: Relative errors of a frame beyond which no linear model tells them.
_LINEAR = 0.1
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
#: Of what hinges that are off are told, by the finding of what explains the distances.
_PLACES = {
    "hinge-misplaced": "hinge",
    "positions-offset": "servo",
    "frame-scaled": "rescaled",
    "scale-differs": "apart",
}
#: Names fit about as well where the hinges miss by so many times as much at most.
_ALIKE = 3.0
#: Digits, of a radian, in which two turns differ of which one is the smaller.
_LIKE = 2
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
    limit = _gross_limit(rig, force)
    off, up = _misfit(rig.hinge, position)
    if off <= limit and up > 0:
        check_size(rig, position)
        return
    ways = explanations(rig, position, force)
    facts: dict[str, Value] = {"fits": ", or with ".join(way.words for way in ways) or None}
    facts |= ways[0].written(rig.supports) if ways else {}
    facts |= _farthest(rig, position)
    misplaced = [] if facts["fits"] or off <= limit else _misplaced(rig, position)
    if not (facts["fits"] or any(one.subject for one in misplaced)):
        check_size(rig, position)
    if off <= limit:
        raise DataError(Finding("terminal-overturned", values=facts))
    for found in reversed(misplaced):
        whose = "".join(found.subject) or "all positioners"
        facts = {**facts, **found.values, _PLACES[found.code]: whose}
        facts |= {"by": found.size, "either": len(misplaced) > 1}
    raise DataError(Finding("hinges-off", size=off, unit="m", values=facts))


def _gross_limit(rig: Rig, force: FloatArray | None = None, shape: float = _SHAPE) -> float:
    """Rms distance from the rig file's pattern, m, above which no fit can be trusted.

    force : (K, n, 3), N, readings, under which declared supports give; None where none do.
    shape : share of the size that is allowed beside the stated uncertainties.
    """
    stated, give = rig.declared, 0.0
    radius = float(np.linalg.norm(rig.hinge - rig.hinge.mean(axis=0), axis=1).mean())
    if force is not None:
        load = float(np.median(np.linalg.norm(force, axis=2), axis=0).max())
        # What is not measured carries a part of the weight at most.
        load = max(load, float(rig.mass.value) * rig.gravity)
        give = load * max(stated.compliance_lateral, stated.compliance_vertical)
    own = np.sqrt(stated.hinge**2 + stated.datum**2 + stated.positioner**2)
    return shape * radius + 6 * (float(own) + give)


def _misfit(hinge: FloatArray, position: FloatArray) -> tuple[float, float]:
    """Medians over the postures: rms distance after registration in m, and height of LCS z."""
    R, T = register(hinge, position)
    off = position - (np.einsum("kab,nb->kna", R, hinge) + T[:, None])
    rms = np.sqrt(np.mean(np.sum(off**2, axis=2), axis=1))
    return float(np.median(rms)), float(np.median(R[:, 2, 2]))


def _misplaced(rig: Rig, position: FloatArray) -> list[Finding]:
    """The hinges or positioners one of which explains the distances, the likeliest first."""
    variance = np.full(len(position), rig.declared.positioner**2)
    found = geometry.examine(rig, position, variance, frames=True)
    linear = all(np.abs(c.amount).max() < _LINEAR for c in found.causes if not CODES[c.kind][1])
    told = found.findings(rig) if found.explained and linear else ()
    likeliest = [one.code in _PLACES for one in told[:1]]
    return [one for one in told if one.code in _PLACES] if any(likeliest) else []


def bent(
    supports: tuple[str, ...], position: FloatArray
) -> tuple[tuple[Finding, ...], Wiring | None]:
    """Find positions (K, n, 3), m, of no rigid terminal, and the mistake without which they are.

    Asked where nothing is known of the hinges. Postures without finite numbers are left out.
    """
    from tdfscal.checks.wiring import bent_positions

    position = position[np.isfinite(position).all(axis=(1, 2))]
    if len(position) == 0 or (varies := _bend(position)) <= _SHAPE:
        return (), None
    best = min(bent_positions(supports), key=lambda way: _bend(way.signals(position)))
    fits = _bend(best.signals(position)) <= _SHAPE
    values = {"fits": best.words, **best.written(supports)} if fits else {}
    found = Finding("positions-bent", size=varies, values=values)
    return (found,), best if fits else None


def _bend(position: FloatArray) -> float:
    """Rms by which the shape of positions (K, n, 3) varies, relative to its size."""
    shape, _, spread = mean_shape(position)
    return spread / float(np.linalg.norm(shape, axis=1).mean())


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

    Supports of a symmetric rig renamed in a circle, positions and forces, look like a terminal that
    is turned. No reading contradicts it, and the angles would be other sensors': it rejects.
    """
    turn = _turn(rig, position)
    angle = float(np.linalg.norm(turn))
    if angle <= _TURNED:
        return ()
    R, _ = register(rig.hinge, position)
    about = turn / angle
    axis = int(np.argmax(np.abs(about)))
    values: dict[str, Value] = {"always": bool(np.linalg.norm(so3.log(R), axis=1).min() > _TURNED)}
    if abs(about[axis]) > np.cos(_TURNED / 2):
        values["axis"] = f"{'-' if about[axis] < 0 else ''}{'XYZ'[axis]}"
    other = upright(rig, position)
    renamed = other is not None and other.whole
    if other is not None and renamed:
        values["upright"] = other.words.removeprefix("the positions of ")
    found = Finding("terminal-turned", size=angle, unit="rad", values=values, rejects=renamed)
    return (found,)


def upright(rig: Rig, position: FloatArray) -> Wiring | None:
    """The names by which a terminal that stands turned, (K, n, 3) in m, would stand upright.

    They fit the hinges about as well as those that it has, or better.
    """
    if np.linalg.norm(_turn(rig, position)) <= _TURNED:
        return None
    from tdfscal.checks.wiring import exchanged_supports, frames

    ways = (*exchanged_supports(rig.supports), *frames(rig.n))
    off, _ = _misfit(rig.hinge, position)
    alike = _ALIKE * off + _gross_limit(rig, shape=0.0)
    found = _fitting(rig, position, min(alike, _gross_limit(rig)), ways)
    return min(found, key=lambda way: way[0])[1] if found else None


def _fitting(
    rig: Rig, position: FloatArray, limit: float, ways: Iterable[Wiring], most: float = _TURNED
) -> list[tuple[float, Wiring]]:
    """Names by which positions fit the hinges upright, and how far the terminal is turned, rad."""
    found = []
    for other in ways:
        place = other.signals(position)
        off, up = _misfit(rig.hinge, place)
        left = float(np.linalg.norm(_turn(rig, place)))
        if off <= limit and up > 0 and left <= most:
            found.append((round(left, _LIKE), other))
    return found


def _turn(rig: Rig, position: FloatArray) -> FloatArray:
    """Rotation vector (3,), rad, of the terminal's middle orientation over the postures."""
    R, _ = register(rig.hinge, position)
    return np.asarray(so3.log(so3.project(R.mean(axis=0))))


def explanations(rig: Rig, position: FloatArray, force: FloatArray | None = None) -> list[Wiring]:
    """The names by which positions fit upright with the terminal least turned.

    More than one where hinges are symmetric, so that a left-handed log looks as if supports were
    exchanged: forces tell which. Parameters as in `check_geometry`.
    """
    from tdfscal.checks.wiring import rewired_positions

    limit = _gross_limit(rig, force)
    found = _fitting(rig, position, limit, rewired_positions(rig.supports), np.inf)
    found = sorted(found, key=lambda way: (way[0], not way[1].mirror))
    alike = [way for left, way in found[1:] if left == found[0][0] and way.whole]
    return [found[0][1], *(alike if found[0][1].mirror else ())] if found else []


def mirrors(rig: Rig, position: FloatArray) -> list[Wiring]:
    """Left-handed logs by which positions (K, n, 3), m, fit the hinges upright."""
    from tdfscal.checks.wiring import frames

    ways = (way for way in frames(rig.n) if way.mirror)
    return [way for _, way in _fitting(rig, position, _gross_limit(rig), ways)]


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
