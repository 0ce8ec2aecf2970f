"""A calibration file is of its rig, has rotations and covariances, and does not contradict itself.

What a digest does not cover is checked: files of other programs have none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.acceptance import turn_std
from tdfscal.files.calibration.parameters import (
    Parameters,
    calibrated_from,
    places,
    turn_parameters,
)
from tdfscal.files.calibration.parts import CONVENTION, CONVENTION_WITH_SENSITIVITY, Status
from tdfscal.files.field_types import fault
from tdfscal.model.parameters import layout, symmetric
from tdfscal.numerics import so3
from tdfscal.records import ANGLES, FloatArray

if TYPE_CHECKING:
    from tdfscal.files.calibration.document import Calibration
    from tdfscal.files.calibration.evidence import ReadingsTable

Place = tuple[str | int, ...]
Repeated = tuple[Place, str, Any, Any]
"""What stands at a place of a file, from which others it follows too, and what follows."""

UNCONFIRMED = "draft-unconfirmed"
"""Code of the finding that makes an accepted result provisional."""
SAME = 1e-9
"""Two statements of one value agree within this, relative or in its unit."""
SAME_STD = 1e-6
"""Two statements of one standard uncertainty agree within this, relative."""
_COVARIANCE, _VALUES, _VARIANCES = "covariance.matrix", "parameters.value", "parameters.matrix"
ALTERED = (
    "for new zeros or another load run `tdfscal update CALIBRATION CAMPAIGN -o FILE`; else take "
    "the file as it was written, with all digits, or calibrate again"
)
"""What to do with a calibration file that was edited."""
CHANGED = "the file was changed after tdfscal wrote it (its content_sha256 does not match)"
"""What is said of one that has a digest."""


def status_of(found: Iterable[tuple[str, str]]) -> Status:
    """Return the verdict that follows from the codes and severities of all that was found."""
    each = tuple(found)
    if any(severity == "rejects" for _, severity in each):
        return "rejected"
    return "provisional" if any(code == UNCONFIRMED for code, _ in each) else "accepted"


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def check(c: Calibration) -> None:
    """Raise the model's fault, which names the place, where a file is not whole or consistent."""
    _check_method(c)
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
    for place, source, stated, other in (*_angles(c), *_zeros_and_load(c)):
        std = str(place[-1]).endswith("std")
        rtol, atol = (SAME_STD, 0.0) if std else (SAME, SAME)
        values = np.array(stated, dtype=np.float64)  # None, which stands for nothing, is NaN
        if not np.all(np.isnan(values) | np.isclose(values, other, rtol=rtol, atol=atol)):
            raise fault(f"disagrees with {source}", *place, hint=ALTERED)


def _check_method(c: Calibration) -> None:
    """Refuse a verdict, blocks and an equation that do not belong to what was found and done."""
    if c.status != status_of((f.code, f.severity) for f in c.findings):
        raise fault(f"is `{c.status}` against `findings`", "status", hint=ALTERED)
    if c.method == "self" and (None in (c.estimator, c.fit, c.observability)):
        raise fault("lacks `estimator`, `fit` or `observability`, which the method `self` has")
    if c.method == "tracker" and c.estimator is not None:
        raise fault("belongs to self-calibration, not to the method `tracker`", "estimator")
    scaled = any(support.sensitivity is not None for support in c.supports)
    if c.convention != (CONVENTION_WITH_SENSITIVITY if scaled else CONVENTION):
        given = "some supports" if scaled else "no support"
        raise fault(f"does not fit: {given} have a `sensitivity`", "convention")
    for index, (support, rig) in enumerate(zip(c.supports, c.rig.supports, strict=False)):
        if not support.determined and set(rig.axes) == {"x", "y", "z"}:
            raise fault("is missing, though the sensor lacks no axis", "supports", index)
    if not c.determined.any():
        raise fault("have no rotation, none of them", "supports")


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
    free = len((c.parameters or c.covariance).parameters)
    for k, one in enumerate(c.taken_as_exact):
        yield ("taken_as_exact", k, "effect"), one.effect, len(c.mounted)
        yield ("taken_as_exact", k, "common"), one.common, free
        yield ("taken_as_exact", k, "apart"), one.apart, free
    n = len(c.supports)
    held: list[tuple[Place, ReadingsTable | None]] = [(("dwells",), c.dwells)]
    for k, campaign in enumerate(c.campaigns):
        yield ("campaigns", k, "zero"), campaign.zero, n
        yield ("campaigns", k, "zero_std"), campaign.zero_std, n
        held.append((("campaigns", k, "readings"), campaign.readings))
    for place, table in held:
        if table is not None:
            yield (*place, "noise"), table.noise, n
            yield from (((*place, "force", k), row, n) for k, row in enumerate(table.force))


def _angles(c: Calibration) -> Iterator[Repeated]:
    """Yield what follows from rotations and covariance, where it stands too."""
    variance = so3.rpy_variance(c.rotation, c.rotation_covariance)
    turns = turn_std(c.rotation_covariance)
    for i in np.flatnonzero(c.determined).tolist():
        support, R, place = c.supports[i], c.rotation[i], ("supports", i)
        source = f"supports[{i}].rotation"
        yield (*place, "rpy"), source, so3.from_rpy(np.array(support.rpy, dtype=np.float64)), R
        quaternion, stated = so3.to_quaternion(R), np.array(support.quaternion_xyzw)
        yield (*place, "quaternion_xyzw"), source, stated * np.sign(stated @ quaternion), quaternion
        if support.turn_std is not None:
            yield (*place, "turn_std"), _COVARIANCE, support.turn_std, turns[i]
        if not so3.locked(R):
            std = np.sqrt(np.maximum(variance[i], 0.0))
            yield (*place, "rpy_std"), _COVARIANCE, support.rpy_std, std


def _zeros_and_load(c: Calibration) -> Iterator[Repeated]:
    """Yield zeros, sensitivities and load by the block of all parameters."""
    if c.parameters is None:
        return
    given, n = calibrated_from(c.parameters, c.rig.record(), c.rotation), len(c.supports)
    state, std, at = given.state, np.sqrt(np.diagonal(given.covariance)), layout(n)
    zero_std, scale = std[at["zero"]].reshape(n, 3), np.eye(3) + symmetric(state.sensitivity)
    for i, support in enumerate(c.supports):
        yield ("supports", i, "zero"), _VALUES, support.zero, state.zero[i]
        yield ("supports", i, "zero_std"), _VARIANCES, support.zero_std, zero_std[i]
        yield ("supports", i, "sensitivity"), _VALUES, c.sensitivity[i], scale[i]
    for name, stated, value, row in (
        ("mass", c.terminal.mass, state.mass, at["mass"]),
        ("barycenter", c.terminal.barycenter, state.barycentre, at["barycentre"]),
    ):
        yield ("terminal", name, "value"), _VALUES, stated.value, value
        yield ("terminal", name, "std"), _VARIANCES, stated.std, std[row]


def _covariance(
    rows: Sequence[Sequence[float]], size: int, *place: str | int, mixed: bool = False
) -> FloatArray:
    """Return the matrix (size, size), symmetric and positive semidefinite to rounding.

    mixed : parameters have units of their own, and so each its own rounding.
    """
    if len(rows) != size or any(len(row) != size for row in rows):
        raise fault(f"must have {size} rows of {size} numbers", *place)
    matrix = np.array(rows)
    scale, rounding = np.full(size, np.sqrt(np.abs(matrix).max() or 1.0)), 1e-12
    if mixed:
        scale, rounding = np.sqrt(np.diagonal(matrix).clip(1e-300)), 1e-9
    unit = matrix / np.outer(scale, scale)
    if not np.allclose(unit, unit.T, rtol=0, atol=rounding):
        raise fault("is not symmetric", *place, hint=ALTERED)
    if np.linalg.eigvalsh(unit)[0] < -rounding:
        raise fault("is not positive semidefinite", *place, hint=ALTERED)
    return matrix


def _check_parameters(c: Calibration, block: Parameters, rotations: FloatArray) -> None:
    """Refuse a block of all parameters that contradicts itself or the covariance of `rotations`."""
    place, turns = places(block, c.support_names), np.flatnonzero(np.repeat(c.determined, 3))
    matrix = _covariance(block.matrix, len(place), "parameters", "matrix", mixed=True)
    if len(block.value) != len(place):
        raise fault(f"must have {len(place)} numbers", "parameters", "value")
    if block.unscaled is not None:
        _covariance(block.unscaled, len(rotations), "parameters", "unscaled")
    if not set(turns.tolist()) <= set(place):
        raise fault("lacks turns that `covariance` has", "parameters", "parameters")
    rows = np.searchsorted(place, turns)
    own = matrix[np.ix_(rows, rows)]
    if np.abs(own - rotations).max() > 1e-9 * np.abs(own).max():
        raise fault(f"disagrees with {_COVARIANCE}", "parameters", "matrix", hint=ALTERED)
