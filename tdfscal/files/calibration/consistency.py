"""A calibration file is of its rig, has rotations and covariances, and does not contradict itself.

What a digest does not cover is checked: files of other programs have none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tdfscal.acceptance.gate import turn_std
from tdfscal.files.calibration.parameters import (
    Parameters,
    calibrated_from,
    places,
    turn_parameters,
)
from tdfscal.files.calibration.parts import (
    CONVENTION,
    CONVENTION_WITH_SENSITIVITY,
    DwellTable,
    ReadingsTable,
)
from tdfscal.files.field_types import Strict, fault
from tdfscal.model.parameters import layout, symmetric
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf, coverage_factor
from tdfscal.records import ANGLES, FloatArray

if TYPE_CHECKING:
    from tdfscal.files.calibration.document import Calibration

Status = Literal["accepted", "provisional", "rejected"]
Place = tuple[str | int, ...]
Statement = tuple[Place, Any, Any]
"""What stands at a place of a file, and what it must be."""
Repeated = tuple[Place, str, Any, Any]
"""What stands at a place of a file, from which others it follows too, and what follows."""

UNCONFIRMED = "draft-unconfirmed"
"""Code of the finding that makes an accepted result provisional."""
SAME = 1e-9
"""Two statements of one value agree within this, relative or in its unit."""
SAME_STD = 1e-6
"""Two statements of one standard uncertainty agree within this, relative."""
_COVARIANCE, _VALUES, _VARIANCES = "covariance.matrix", "parameters.value", "parameters.matrix"
#: Names that a message gives of a list as it should be.
_NAMED = 6
ALTERED = (
    "for new zeros or another load run `tdfscal update CALIBRATION CAMPAIGN -o FILE`; else take "
    "the file as it was written, with all digits, or calibrate again"
)
"""What to do with a calibration file that was edited."""
CHANGED = "the file was changed after tdfscal wrote it (its content_sha256 does not match)"
"""What is said of one that has a digest."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def check(c: Calibration) -> None:
    """Raise the model's fault, which names the place, where a file is not whole or consistent."""
    _check_method(c)
    for place, stated, expected in _shape(c):
        if stated != expected:
            must = f"have {expected} rows"
            if isinstance(expected, list):
                more = ", …" if len(expected) > _NAMED else ""
                must = f"name {', '.join(expected[:_NAMED])}{more}, in this order, each once"
            raise fault(f"must {must}", *place, hint=ALTERED)
    size = 3 * int(c.determined.sum())
    matrix = checked_covariance(c.covariance.matrix, size, "covariance", "matrix")
    if c.parameters is not None:
        _check_parameters(c, c.parameters, matrix)
    for index in np.flatnonzero(c.determined).tolist():
        check_rotation(c.rotation[index], "supports", index, "rotation")
    for place, source, stated, other in said_twice(c):
        std = str(place[-1]).endswith(("std", "variance"))
        rtol, atol = (SAME_STD, 0.0) if std else (SAME, SAME)
        values = np.array(stated, dtype=np.float64)  # None, which stands for nothing, is NaN
        if not np.all(np.isnan(values) | np.isclose(values, other, rtol=rtol, atol=atol)):
            raise fault(f"disagrees with {source}", *place, hint=ALTERED)


def status_of(found: Iterable[tuple[str, str]]) -> Status:
    """Return the verdict that follows from the codes and severities of all that was found."""
    each = tuple(found)
    if any(severity == "rejects" for _, severity in each):
        return "rejected"
    return "provisional" if any(code == UNCONFIRMED for code, _ in each) else "accepted"


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


def _shape(c: Calibration) -> Iterator[Statement]:
    """Yield names in their order, as lists, and numbers of rows, as they must be."""
    yield ("supports",), list(c.support_names), [support.name for support in c.rig.supports]
    stand = [support.name for support in c.supports if support.determined]
    turns = list(turn_parameters(stand))
    yield ("covariance", "parameters"), list(c.covariance.parameters), turns
    for k, one in enumerate(c.taken_as_exact):
        here = "taken_as_exact", k
        yield (*here, "supports"), [effect.name for effect in one.supports], stand
        free = turns if c.parameters is None else c.parameters.parameters
        yield from _rows(here, one, ("common", "apart"), len(free))
    if c.budget is not None:
        yield ("budget", "sources"), len(set(c.budget.sources)), len(c.budget.sources)
        sources, angles = sorted(c.budget.sources), [f"{s}.{a}" for s in stand for a in ANGLES]
        for k, entry in enumerate(c.budget.angles):
            yield ("budget", "angles", k, "variance"), sorted(entry.variance), sources
        yield ("budget", "angles"), [f"{e.support}.{e.angle}" for e in c.budget.angles], angles
    n = len(c.supports)
    yield from _rows(("monte_carlo",), c.monte_carlo, ("rpy_std", "low", "high", "histogram"), n)
    yield from _rows(("fit",), c.fit, ("channel_noise",), n)
    for k, campaign in enumerate(c.campaigns):
        yield from _rows(("campaigns", k), campaign, ("zero", "zero_std"), n)
        yield from _readings(("campaigns", k, "readings"), campaign.readings, n)
    if c.motion is not None:
        yield from _readings(("motion", "readings"), c.motion.readings, n)
    for k, method in enumerate(c.methods or ()):
        yield from _rows(("methods", k), method, ("rpy", "rpy_std"), n)
    tables: dict[Place, Strict | None] = {("postures",): c.postures}
    if c.motion is not None:
        tables[("motion", "spectrum")] = c.motion.spectrum
        tables[("motion", "residual")] = c.motion.residual
    for place, table in tables.items():
        if table is not None:
            columns = [name for name in type(table).model_fields if name != "left_out"]
            yield from _rows(place, table, columns, len(getattr(table, columns[0])))
    if c.dwells is not None:
        count = len(c.dwells.start)
        yield from _rows(("dwells",), c.dwells, ("end", "temperature"), count)
        yield from _readings(("dwells",), c.dwells, n, count)


def _readings(
    place: Place, table: ReadingsTable | DwellTable | None, n: int, count: int | None = None
) -> Iterator[Statement]:
    """The numbers of rows of mean readings of n supports; count : of each one's, if known."""
    yield from _rows(place, table, ("force", "noise"), n)
    counts = [] if table is None else [len(rows) for rows in table.force]
    for i, rows in enumerate(counts):
        yield (*place, "force", i), rows, counts[0] if count is None else count


def _rows(place: Place, holder: Strict | None, names: Iterable[str], count: int) -> list[Statement]:
    """The numbers of rows of these tables of a block, those that are there."""
    tables = ((name, getattr(holder, name, None)) for name in names)
    return [((*place, name), len(rows), count) for name, rows in tables if rows is not None]


def said_twice(c: Calibration) -> Iterator[Repeated]:
    """Yield what follows from rotations, covariances, parameters and χ², where it stands too."""
    variance = so3.rpy_variance(c.rotation, c.rotation_covariance)
    turns = turn_std(c.rotation_covariance)
    for i in np.flatnonzero(c.determined).tolist():
        support, R, place = c.supports[i], c.rotation[i], ("supports", i)
        source = f"supports[{i}].rotation"
        yield (*place, "rpy"), source, so3.from_rpy(np.array(support.rpy, dtype=np.float64)), R
        quaternion, stated = so3.to_quaternion(R), np.array(support.quaternion_xyzw)
        signed = stated * np.sign(stated @ quaternion)
        yield (*place, "quaternion_xyzw"), source, signed, quaternion
        if support.turn_std is not None:
            yield (*place, "turn_std"), _COVARIANCE, support.turn_std, turns[i]
        if not so3.locked(R):
            std = np.sqrt(np.maximum(variance[i], 0.0))
            yield (*place, "rpy_std"), _COVARIANCE, support.rpy_std, std
            yield from _interval(c, i)
    if c.parameters is not None:
        yield from _zeros_and_load(c, c.parameters)
    for k, entry in enumerate(c.budget.angles if c.budget is not None else ()):
        i, j = c.support_names.index(entry.support), ANGLES.index(entry.angle)
        if not so3.locked(c.rotation[i]):
            named, std = ("budget", "angles", k, "variance"), np.sqrt(sum(entry.variance.values()))
            yield named, _COVARIANCE, std, np.sqrt(variance[i, j])
    for name in ("force", "torque") if c.conformity is not None else ():
        own, rigs = getattr(c.conformity, name), getattr(c.rig.acceptance.contact, name, None)
        limit = np.array(rigs, dtype=np.float64)  # NaN where there is none
        yield ("conformity", name, "limit"), "rig.acceptance", own.limit, limit
    if c.fit is not None and c.fit.dof:
        source, p = "fit.chi2 and fit.dof", chi2_sf(c.fit.chi2, c.fit.dof)
        yield ("fit", "p_value"), source, c.fit.p_value, p
        yield ("fit", "birge"), source, c.fit.birge, np.sqrt(c.fit.chi2 / c.fit.dof)


def _interval(c: Calibration, i: int) -> Iterator[Repeated]:
    """Yield the middle and the half of a support's interval, unless they are the Monte Carlo's.

    No k is smaller than that of a normal distribution.
    """
    place = "supports", i, "rpy_interval"
    interval, trials = c.supports[i].rpy_interval, c.monte_carlo
    if interval is not None:
        low, high = (np.array(ends, dtype=np.float64) for ends in (interval.low, interval.high))
        drawn = None if trials is None else [trials.low[i], trials.high[i]]
        if drawn is None or not np.allclose([low, high], drawn, rtol=0, atol=SAME):
            yield place, f"supports[{i}].rpy", (low + high) / 2, c.rpy[i]
            half, k = (high - low) / 2, 0.999 * coverage_factor(interval.coverage)
            yield place, f"supports[{i}].rpy_std", half, np.maximum(half, k * c.rpy_std[i])


def _zeros_and_load(c: Calibration, block: Parameters) -> Iterator[Repeated]:
    """Yield zeros, sensitivities and load by the block of all parameters."""
    given, n = calibrated_from(block, c.rig.record(), c.rotation), len(c.supports)
    state, std, at = given.state, np.sqrt(np.diagonal(given.covariance)), layout(n)
    zero_std, scale = std[at["zero"]].reshape(n, 3), np.eye(3) + symmetric(state.sensitivity)
    for i, support in enumerate(c.supports):
        yield ("supports", i, "zero"), _VALUES, support.zero, state.zero[i]
        yield ("supports", i, "zero_std"), _VARIANCES, support.zero_std, zero_std[i]
        yield ("supports", i, "sensitivity"), _VALUES, c.sensitivity[i], scale[i]
    for name, value, group in (
        ("mass", state.mass, "mass"),
        ("barycenter", state.barycentre, "barycentre"),
    ):
        stated = getattr(c.terminal, name)
        yield ("terminal", name, "value"), _VALUES, stated.value, value
        yield ("terminal", name, "std"), _VARIANCES, stated.std, std[at[group]]


def check_rotation(R: FloatArray, *place: str | int) -> None:
    """Refuse a matrix (3, 3) that is no rotation."""
    orthonormal = np.allclose(R @ R.T, np.eye(3), rtol=0, atol=SAME)
    if not orthonormal or np.linalg.det(R) < 0:
        raise fault("is not a rotation: not orthonormal, or det ≠ +1", *place, hint=ALTERED)


def checked_covariance(
    rows: Sequence[Sequence[float]] | FloatArray, size: int, *place: str | int, mixed: bool = False
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
    matrix = checked_covariance(block.matrix, len(place), "parameters", "matrix", mixed=True)
    if len(block.value) != len(place):
        raise fault(f"must have {len(place)} numbers", "parameters", "value")
    if block.unscaled is not None:
        checked_covariance(block.unscaled, len(rotations), "parameters", "unscaled")
    if not set(turns.tolist()) <= set(place):
        raise fault("lacks turns that `covariance` has", "parameters", "parameters")
    rows = np.searchsorted(place, turns)
    own = matrix[np.ix_(rows, rows)]
    if np.abs(own - rotations).max() > 1e-9 * np.abs(own).max():
        raise fault(f"disagrees with {_COVARIANCE}", "parameters", "matrix", hint=ALTERED)
