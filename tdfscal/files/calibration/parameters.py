"""The calibration file's block of all parameters together, its way to the records, and whether a
file agrees with itself: with its rig, as rotations and covariances, and where it says things twice.

What a digest does not cover is checked: files of other programs have none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.acceptance import turn_std
from tdfscal.files.calibration.parts import Status
from tdfscal.files.field_types import Matrix, Numbers, Strict, Text, fault, key, measured_only
from tdfscal.files.saving import plain
from tdfscal.model.parameters import (
    State,
    deviation,
    layout,
    nominal,
    parameter_count,
    placed,
    retract,
    symmetric,
)
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import triangular
from tdfscal.records import ANGLES, BoolArray, ExactMoves, FloatArray, IntArray, UncertainValue

if TYPE_CHECKING:  # pulls in the estimator, which a file's reader can do without
    from tdfscal.files.calibration.document import Calibration
    from tdfscal.files.calibration.evidence import ReadingsTable
    from tdfscal.model.calibrated import Calibrated

Place = tuple[str | int, ...]
Repeated = tuple[Place, str, Any, Any]
"""What stands at a place of a file, from which others it follows too, and what follows."""

UNCONFIRMED = "draft-unconfirmed"
"""Code of the finding that makes an accepted result provisional."""
#: Within which two statements of one value agree, relative or in its unit; of one standard
#: uncertainty, relative.
SAME, SAME_STD = 1e-9, 1e-6
_COVARIANCE, _VALUES, _VARIANCES = "covariance.matrix", "parameters.value", "parameters.matrix"
ALTERED = (
    "for new zeros or another load run `tdfscal update CALIBRATION CAMPAIGN -o FILE`; else take "
    "the file as it was written, with all digits, or calibrate again"
)
"""What to do with a calibration file that was edited."""
_COMPONENTS = {
    "rotation": ("rx", "ry", "rz"),
    "zero": ("zero.x", "zero.y", "zero.z"),
    "sensitivity": tuple(f"sensitivity.{c}" for c in ("xx", "yy", "zz", "yz", "xz", "xy")),
    "mass": ("mass",),
    "barycentre": ("barycenter.x", "barycenter.y", "barycenter.z"),
    "hinge": ("hinge.x", "hinge.y", "hinge.z"),
    "datum": ("datum.x", "datum.y", "datum.z"),
    "tilt": ("gravity.tilt_x", "gravity.tilt_y"),
    "compliance": ("compliance.lateral", "compliance.vertical"),
    "friction": ("hinge_friction",),
    "drift": (),
}
_OF_THE_RIG = ("mass", "barycentre", "tilt", "compliance", "friction")


class Parameters(Strict):
    """Every parameter that was free, with the covariance of all of them together."""

    parameters: tuple[Text, ...] = key("names of rows and columns")
    value: Numbers = key("SI: estimate minus stated value of the embedded rig; rotations 0")
    matrix: Matrix = key("SI: joint covariance; rotations as in `covariance`")
    unscaled: Matrix | None = key(
        "rad²: covariance of the rotations before the Birge ratio scaled it", None
    )


def parameter_order(supports: tuple[str, ...]) -> tuple[str, ...]:
    """Names of all parameters (P,) in the order of `parameters.layout`."""
    each = [f"{name}." for name in supports]
    owners = {g: [""] if g in _OF_THE_RIG else each for g in layout(len(supports))}
    return tuple(owner + part for g in owners for owner in owners[g] for part in _COMPONENTS[g])


def turn_parameters(supports: Sequence[str]) -> tuple[str, ...]:
    """Names of the covariance's rows: `ncp1.rx`, `ncp1.ry`, `ncp1.rz`, `ncp2.rx` …."""
    return tuple(f"{name}.{axis}" for name in supports for axis in _COMPONENTS["rotation"])


def parameters_document(given: Calibrated, unscaled: FloatArray | None = None) -> dict[str, Any]:
    """The block of a calibration whose covariance is joint; unscaled : (3n, 3n), rad²."""
    used = np.flatnonzero(np.diagonal(given.covariance))
    order = parameter_order(given.rig.supports)
    start = replace(nominal(given.rig), rotation=given.state.rotation)
    return {
        "parameters": [order[k] for k in used],
        "value": deviation(given.state, start)[used],
        "matrix": given.covariance[np.ix_(used, used)],
        "unscaled": unscaled,
    }


def parameter_rows(named: Sequence[str], supports: tuple[str, ...]) -> IntArray:
    """Places of parameters by their names among all of them."""
    return np.flatnonzero(np.isin(parameter_order(supports), named))


def finite(document: Any) -> Any:
    """A document of records and arrays as plain values; what is open, ∞, is null."""
    return plain(document, null=lambda number: number == np.inf)


def zeros_and_load(state: State, std: State, axes: BoolArray) -> dict[str, Any]:
    """Zeros of the axes (n, 3) that are measured, and the load; std : theirs, ∞ where open."""
    return {
        "zero": measured_only(state.zero, axes),
        "zero_std": measured_only(std.zero, axes),
        "terminal": {
            "mass": {"value": state.mass, "std": std.mass},
            "barycenter": {"value": state.barycentre, "std": std.barycentre},
        },
    }


def angles_document(
    rotation: FloatArray, covariance: FloatArray, determined: BoolArray
) -> dict[str, FloatArray]:
    """What the file states of rotations (n, 3, 3) and their covariance (3n, 3n) beside them.

    A row per sensor; ∞, which becomes null, for the angles of one that is not determined (n,), and
    for the rpy_std of roll and yaw that are not separable.
    """
    std = np.sqrt(np.maximum(so3.rpy_variance(rotation, covariance), 0.0))
    separable = determined & ~so3.locked(rotation)
    return {
        "rpy": np.where(determined[:, None], so3.to_rpy(rotation), np.inf),
        "rpy_std": np.where(separable[:, None], std, np.inf),
        "turn_std": turn_std(covariance),
        "quaternion_xyzw": so3.to_quaternion(rotation),
    }


def exact_moves_document(moves: ExactMoves, rows: IntArray) -> dict[str, Any]:
    """A quantity, and moves of the parameters at `rows` by errors of it; None where there are none.

    Independent errors are as good as as many that have the same covariance.
    """
    common, apart = moves.common[rows], moves.apart[rows]
    apart = triangular(apart.T).T if apart.shape[1] > len(rows) else apart
    moved = {name: v if v.any() else None for name, v in (("common", common), ("apart", apart))}
    return {"name": moves.name, "error": moves.error, "unit": moves.unit, **moved}


def exact_moves(c: Calibration) -> tuple[ExactMoves, ...]:
    """How all parameters (P,) move with errors of what a calibration took as exact."""
    rows = parameter_rows((c.parameters or c.covariance).parameters, c.support_names)

    def whole(side: Sequence[Sequence[float]] | None) -> FloatArray:
        out = np.zeros((parameter_count(len(c.supports)), len(side[0]) if side else 0))
        out[rows] = side or np.zeros((len(rows), 0))
        return out

    return tuple(
        ExactMoves(one.name, one.error, one.unit, whole(one.common), whole(one.apart))
        for one in c.taken_as_exact
    )


def calibrated(c: Calibration) -> Calibrated:
    """Return the parameters of a calibration file with their covariance."""
    from tdfscal.model.calibrated import Calibrated, independent

    rig = c.rig.record()
    if (block := c.parameters) is not None:
        place, size = places(block, rig.supports), parameter_count(rig.n)
        step, covariance = np.zeros(size), np.zeros((size, size))
        step[place], covariance[np.ix_(place, place)] = block.value, block.matrix
        state = retract(replace(nominal(rig), rotation=c.rotation), step)
        known = np.zeros(size, dtype=np.bool_)
        return Calibrated(rig, replace(state, rotation=c.rotation), covariance, known, joint=True)
    error = c.sensitivity - np.eye(3)
    return independent(
        rig,
        c.rotation,
        c.rotation_covariance,
        zero=UncertainValue(c.zero, c.zero_std),
        mass=c.terminal.mass.record(),
        barycentre=c.terminal.barycenter.record(),
        sensitivity=error[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
    )


def unscaled(c: Calibration) -> Calibrated:
    """Return them before any scaling by a Birge ratio."""
    from tdfscal.model.calibrated import with_rotations

    known = calibrated(c)
    if c.parameters is None or c.parameters.unscaled is None:
        return known
    stand = np.zeros(len(known.covariance), dtype=np.bool_)
    stand[: 3 * len(c.determined)] = np.repeat(c.determined, 3)
    order = np.argsort(~stand, kind="stable")  # with_rotations replaces the first block
    back, own = np.argsort(order), np.array(c.parameters.unscaled)
    moved = with_rotations(known.covariance[np.ix_(order, order)], int(stand.sum()), own)
    return replace(known, covariance=moved[np.ix_(back, back)])


def places(block: Parameters, supports: tuple[str, ...]) -> IntArray:
    """Where the block's parameters are among all; raises the model's fault."""
    order, place = parameter_order(supports), parameter_rows(block.parameters, supports)
    for name in block.parameters:
        if name not in order:
            raise fault(f"names no parameter of this rig: {name}", "parameters", "parameters")
    if [order[k] for k in place] != [*block.parameters]:
        raise fault("are not in their order, each once", "parameters", "parameters")
    return place


def status_of(found: Iterable[tuple[str, str]]) -> Status:
    """Return the verdict that follows from the codes and severities of all that was found."""
    each = tuple(found)
    if any(severity == "rejects" for _, severity in each):
        return "rejected"
    return "provisional" if any(code == UNCONFIRMED for code, _ in each) else "accepted"


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def check(c: Calibration) -> None:
    """Raise the model's fault, which names the place, where a file is not whole or consistent."""
    for place, stated, names in _names(c):
        if list(stated) != names:
            raise fault(f"must name {', '.join(names)}, in this order", *place, hint=ALTERED)
    for place, rows, count in _tables(c):
        if rows is not None and len(rows) != count:
            raise fault(f"must have {count} rows", *place)
    matrix = _covariance(c.covariance.matrix, 3 * int(c.determined.sum()), "covariance", "matrix")
    if c.parameters is not None:
        _check_parameters(c, c.parameters, matrix)
    for index in np.flatnonzero(c.determined).tolist():
        R = c.rotation[index]
        if not np.allclose(R @ R.T, np.eye(3), rtol=0, atol=SAME) or np.linalg.det(R) < 0:
            what = "is not a rotation: not orthonormal, or det ≠ +1"
            raise fault(what, "supports", index, "rotation", hint=ALTERED)
    for place, source, stated, other in _repeated(c):
        std = str(place[-1]).endswith("std")
        rtol, atol = (SAME_STD, 0.0) if std else (SAME, SAME)
        values = np.array(stated, dtype=np.float64)  # None, which stands for nothing, is NaN
        if not np.all(np.isnan(values) | np.isclose(values, other, rtol=rtol, atol=atol)):
            raise fault(f"disagrees with {source}", *place, hint=ALTERED)


def _names(c: Calibration) -> Iterator[tuple[Place, Iterable[str], list[str]]]:
    """Yield the lists that name supports, angles or sources, and what they must name."""
    yield ("supports",), c.support_names, [support.name for support in c.rig.supports]
    stand = [mounting.name for mounting in c.mounted]
    yield ("covariance", "parameters"), c.covariance.parameters, list(turn_parameters(stand))
    if c.budget is not None:
        named = [f"{entry.support}.{entry.angle}" for entry in c.budget.angles]
        yield ("budget", "angles"), named, [f"{name}.{a}" for name in stand for a in ANGLES]
        for k, entry in enumerate(c.budget.angles):
            sources = sorted(set(c.budget.sources))
            yield ("budget", "angles", k, "variance"), sorted(entry.variance), sources


def _tables(c: Calibration) -> Iterator[tuple[Place, Sequence[Any] | None, int]]:
    """Yield the tables that have a row for each support, or each parameter, and how many."""
    n, free = len(c.supports), len((c.parameters or c.covariance).parameters)
    for k, one in enumerate(c.taken_as_exact):
        yield ("taken_as_exact", k, "effect"), one.effect, len(c.mounted)
        yield ("taken_as_exact", k, "common"), one.common, free
        yield ("taken_as_exact", k, "apart"), one.apart, free
    held: dict[Place, ReadingsTable | None] = {("dwells",): c.dwells}
    for k, campaign in enumerate(c.campaigns):
        yield ("campaigns", k, "zero"), campaign.zero, n
        yield ("campaigns", k, "zero_std"), campaign.zero_std, n
        held["campaigns", k, "readings"] = campaign.readings
    for place, table in held.items():
        if table is not None:
            yield (*place, "noise"), table.noise, n
            yield from (((*place, "force", k), row, n) for k, row in enumerate(table.force))


def _repeated(c: Calibration) -> Iterator[Repeated]:
    """Yield what follows from rotations, their covariance, and all parameters, where it stands."""
    known: dict[str, Any] = dict(angles_document(c.rotation, c.rotation_covariance, c.determined))
    for i in np.flatnonzero(c.determined).tolist():
        support, place, source = c.supports[i], ("supports", i), f"supports[{i}].rotation"
        rpy, stated = np.array(support.rpy, dtype=np.float64), np.array(support.quaternion_xyzw)
        quaternion = known["quaternion_xyzw"][i]
        yield (*place, "rpy"), source, so3.from_rpy(rpy), c.rotation[i]
        yield (*place, "quaternion_xyzw"), source, stated * np.sign(stated @ quaternion), quaternion
        for name in ("turn_std", "rpy_std"):
            yield (*place, name), _COVARIANCE, getattr(support, name), known[name][i]
    if c.parameters is None:
        return
    given = calibrated(c)
    std = placed(given.state, np.sqrt(np.diagonal(given.covariance)))
    known = zeros_and_load(given.state, std, given.rig.axes)
    scale = np.eye(3) + symmetric(given.state.sensitivity)
    for i, support in enumerate(c.supports):
        yield ("supports", i, "zero"), _VALUES, support.zero, known["zero"][i]
        yield ("supports", i, "zero_std"), _VARIANCES, support.zero_std, known["zero_std"][i]
        yield ("supports", i, "sensitivity"), _VALUES, c.sensitivity[i], scale[i]
    for name, estimate in c.terminal:
        for what, source in (("value", _VALUES), ("std", _VARIANCES)):
            other = known["terminal"][name][what]
            yield ("terminal", name, what), source, getattr(estimate, what), other


def _covariance(rows: Sequence[Sequence[float]], size: int, *place: str | int) -> FloatArray:
    """Return the matrix (size, size), symmetric and positive semidefinite to rounding."""
    if len(rows) != size or any(len(row) != size for row in rows):
        raise fault(f"must have {size} rows of {size} numbers", *place)
    matrix = np.array(rows)
    scale = np.sqrt(np.abs(np.diagonal(matrix)).clip(1e-300))  # parameters have units of their own
    unit = matrix / np.outer(scale, scale)
    if not np.allclose(unit, unit.T, rtol=0, atol=SAME):
        raise fault("is not symmetric", *place, hint=ALTERED)
    if np.linalg.eigvalsh(unit)[0] < -SAME:
        raise fault("is not positive semidefinite", *place, hint=ALTERED)
    return matrix


def _check_parameters(c: Calibration, block: Parameters, rotations: FloatArray) -> None:
    """Refuse a block of all parameters that contradicts itself or the covariance of `rotations`."""
    place, turns = places(block, c.support_names), np.flatnonzero(np.repeat(c.determined, 3))
    matrix = _covariance(block.matrix, len(place), "parameters", "matrix")
    if len(block.value) != len(place):
        raise fault(f"must have {len(place)} numbers", "parameters", "value")
    if block.unscaled is not None:
        _covariance(block.unscaled, len(rotations), "parameters", "unscaled")
    if not np.isin(turns, place).all():
        raise fault("lacks turns that `covariance` has", "parameters", "parameters")
    rows = np.searchsorted(place, turns)
    if np.any(np.array(block.value)[rows]):  # they are counted from the rotations
        raise fault("gives a turn from `supports[].rotation`", "parameters", "value", hint=ALTERED)
    own = matrix[np.ix_(rows, rows)]
    if np.abs(own - rotations).max() > 1e-9 * np.abs(own).max():
        raise fault(f"disagrees with {_COVARIANCE}", "parameters", "matrix", hint=ALTERED)
