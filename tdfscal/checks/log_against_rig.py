"""Do the log and the rig file speak of the same machine? Units, axes, signs, names.

These checks come before any estimate: a mislabelled log must not become a plausible calibration.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from tdfscal.checks import geometry
from tdfscal.checks.exchanges import orders, renamed
from tdfscal.checks.hinge_distances import Cause
from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.model.parameters import State, gravity, nominal
from tdfscal.model.postures import register
from tdfscal.model.statics import Postures, forces
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig

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
#: Units of force by what they make of a reading in the unit that is declared.
UNITS = {
    1e3: "in N where kN is declared",
    1e-3: "in kN where N is declared",
    1 / 9.80665: "in kgf",
    1 / 4.4482216: "in lbf",
}


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
    found = _explanation(rig, position, limit)
    variance = np.full(len(position), rig.declared.positioner**2)
    pattern = geometry.examine(rig, position, variance)
    placed = off > limit and pattern.explained and pattern.causes[:1]
    if not (found or (placed and placed[0].support is not None)):
        check_size(rig, position)
    wrong = (
        f"the NCP positions miss the hinge pattern of rig.yaml by {1e3 * off:.3g} mm"
        if off > limit
        else "the terminal stands on its head in the log: its z axis points downwards"
    )
    if found:
        wrong += f"; it would fit with {found}"
    elif placed:
        wrong += ": " + ", or ".join(_misplaced(rig, cause) for cause in pattern.causes)
    raise DataError(
        wrong,
        where="log positions",
        hint="correct the position fields of the log block in rig.yaml"
        if found
        else f"measure the hinges again ({_farthest(rig, position)}), or check the position fields "
        "and that log and rig.yaml belong together",
    )


def _misplaced(rig: Rig, cause: Cause) -> str:
    """What does not fit, and by how much, in words."""
    size = float(np.linalg.norm(cause.amount))
    if cause.support is None:
        return "what gives, or a scale, would explain it"
    what = "the hinge of {}" if cause.kind == "hinge" else "the servo coordinates of {}"
    verb = "is not where it is stated" if cause.kind == "hinge" else "are offset"
    more = "" if np.isfinite(cause.std).all() else " or more"
    return f"{what.format(rig.supports[cause.support])} {verb}, by {1e3 * size:.3g} mm{more}"


def _farthest(rig: Rig, position: FloatArray) -> str:
    """The two hinges whose distance in the log, position (K, n, 3), differs most from rig.yaml."""
    first, second = np.triu_indices(rig.n, 1)
    logged = np.median(np.linalg.norm(position[:, first] - position[:, second], axis=2), axis=0)
    stated = np.linalg.norm(rig.hinge[first] - rig.hinge[second], axis=1)
    k = int(np.argmax(np.abs(logged - stated)))
    return (
        f"{rig.supports[first[k]]} to {rig.supports[second[k]]} is {logged[k]:.4f} m in the log "
        f"and {stated[k]:.4f} m in rig.yaml"
    )


def check_size(rig: Rig, position: FloatArray) -> None:
    """Raise DataError where positions (K, n, 3) cannot be in the unit that is declared."""
    p = position - position.mean(axis=1, keepdims=True)
    r = rig.hinge - rig.hinge.mean(axis=0)
    size = float(np.median(np.sqrt(np.sum(p**2, axis=(1, 2)) / np.sum(r**2))))
    if abs(size - 1) <= _SIZE:
        return
    units, foreign = _units(size)
    raise DataError(
        f"the NCPs stand {size:.4g} times as far apart as the hinges of rig.yaml"
        + (f", as if the positions were {units}" if units else ""),
        where="log positions",
        hint="convert the log: log.length_unit knows m, mm and um"
        if foreign
        else "state the recorder's unit as log.length_unit in rig.yaml"
        if units
        else "check log.length_unit, the position fields and the hinge coordinates",
    )


def _units(size: float) -> tuple[str, bool]:
    """Words for the units that make lengths wrong by this factor, and whether none is declarable.

    What is declared is not known here: each is named with the unit that it was taken for.
    """
    for table in (_DECLARED, _FOREIGN):
        found = [
            f"in {own} where {stated} is declared"
            for stated, declared in _DECLARED.items()
            for own, metres in table.items()
            if abs(size * metres / declared - 1) < _SIZE
        ]
        if found:
            return ", or ".join(found), table is _FOREIGN
    return "", False


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
    for order in orders(rig.n):
        off, up = geometry.misfit(rig.hinge, position[:, order])
        left = float(np.linalg.norm(_turn(rig, position[:, order])))
        if off <= limit and up > 0 and left <= _TURNED:
            upright.append((left, renamed(rig, order)))
    if upright:
        values["upright"] = min(upright)[1]
    return (Finding("terminal-turned", size=angle, unit="rad", values=values),)


def _turn(rig: Rig, position: FloatArray) -> FloatArray:
    """Rotation vector (3,), rad, of the terminal's middle orientation over the postures."""
    R, _ = register(rig.hinge, position)
    return np.asarray(so3.log(so3.project(R.mean(axis=0))))


def _explanation(rig: Rig, position: FloatArray, limit: float) -> str | None:
    """Words for the rearrangement that fits upright with the terminal least turned."""
    fitting = []
    for text, candidate in _rearranged(rig, position):
        off, up = geometry.misfit(rig.hinge, candidate)
        if off <= limit and up > 0:
            R, _ = register(rig.hinge, candidate)
            fitting.append((float(np.median(np.linalg.norm(so3.log(R), axis=1))), text))
    return min(fitting)[1] if fitting else None


def _rearranged(rig: Rig, position: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Positions with supports exchanged, or axes exchanged and mirrored, each with its words."""
    for order in orders(rig.n):
        yield f"the positions of {renamed(rig, order)}", position[:, order]
    # A proper rotation of the axes always fits: only mirrors leave a trace.
    for axes, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if np.linalg.det(np.eye(3)[list(axes)] * np.array(signs)) < 0:
            names = ", ".join(
                f"{'-' if s < 0 else ''}{'XYZ'[a]}" for a, s in zip(axes, signs, strict=True)
            )
            yield f"the axes read as {names}", position[..., list(axes)] * np.array(signs)


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
            raise _unit_error(ratio, mass, unit)


def weight_share(state: State, g: float, force: FloatArray) -> FloatArray:
    """Part (K,) of the weight that the readings (K, n, 3), N, hold up: 1 at rest, untouched."""
    weight = state.mass * gravity(state, g)
    total = forces(state, force).sum(axis=1)
    return np.asarray(-(total @ weight) / (weight @ weight))


def weight_tolerance(relative: float) -> float:
    """How far that part may be from 1; relative : standard uncertainty of the mass."""
    return _WEIGHT + 6 * relative


def unit_of(ratio: float) -> str | None:
    """Words for the unit that makes of forces so many times what they should be."""
    return next((name for f, name in UNITS.items() if abs(abs(ratio) / f - 1) < _WEIGHT), None)


def weight_error(ratio: float, allowed: float, mass: float) -> DataError:
    """The error for forces that sum to `ratio` times the weight of `mass`, kg."""
    if abs(ratio + 1) <= allowed:
        return DataError(
            "the forces sum to the weight with the wrong sign, as if the sensors recorded the "
            "reaction",
            where="log forces",
            hint="set log.force_on in rig.yaml to the other value, or state nominal_rpy where a "
            "sensor is mounted upside down",
        )
    return _unit_error(ratio, mass, unit_of(ratio))


def _unit_error(ratio: float, mass: float, unit: str | None) -> DataError:
    return DataError(
        f"the forces sum to {ratio:.3g} times the weight of {mass:.6g} kg"
        + (f", as if they were {unit}" if unit else ""),
        where="log forces",
        hint="check log.force_unit, the force fields, the mass, and nominal_rpy",
    )
