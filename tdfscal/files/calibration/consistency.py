"""What a calibration file says several times agrees, and its parts fit together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from tdfscal.acceptance.turns import turn_std
from tdfscal.files.calibration.parameters import (
    Parameters,
    calibrated_from,
    places,
    turn_parameters,
)
from tdfscal.files.calibration.parts import CONVENTION, CONVENTION_WITH_SENSITIVITY, Mounting
from tdfscal.files.field_types import fault
from tdfscal.model.parameters import State, layout, symmetric
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf, coverage_factor
from tdfscal.records import ANGLES, FloatArray

if TYPE_CHECKING:
    from tdfscal.files.calibration.document import Calibration

Status = Literal["accepted", "provisional", "rejected"]
UNCONFIRMED = "draft-unconfirmed"
"""Code of the finding that makes an accepted result provisional."""
SAME = 1e-9
"""Two statements of one rotation agree within this, per matrix element."""
SAME_STD = 1e-6
"""Two statements of one standard uncertainty agree within this, relative."""
ALTERED = (
    "for new zeros or another load run `tdfscal update CALIBRATION CAMPAIGN -o FILE`; else take "
    "the file as it was written, with all digits, or calibrate again"
)
"""What to do with a calibration file that was edited."""


def check(c: Calibration) -> None:
    """Raise the model's fault, which names the place, where a file contradicts itself."""
    _check_status(c)
    _check_names(c)
    matrix = checked_covariance(
        c.covariance.matrix, 3 * int(c.determined.sum()), "covariance", "matrix"
    )
    if c.parameters is not None:
        _check_parameters(c, c.parameters, matrix)
    for index, support in enumerate(c.supports):
        block = slice(3 * index, 3 * index + 3)
        if support.mounting is not None:
            check_rotation(support.mounting, c.rotation_covariance[block, block], index)
    _check_rows(c)
    check_stated(c)
    if c.rig.edited:
        raise fault("was edited after the calibration", "rig", hint=ALTERED)


def status_of(found: Iterable[tuple[str, str]]) -> Status:
    """Return the verdict that follows from the codes and severities of all that was found."""
    each = tuple(found)
    if any(severity == "rejects" for _, severity in each):
        return "rejected"
    return "provisional" if any(code == UNCONFIRMED for code, _ in each) else "accepted"


def _check_status(c: Calibration) -> None:
    if c.status != status_of((f.code, f.severity) for f in c.findings):
        raise fault(f"is `{c.status}` against `findings`", "status", hint=ALTERED)
    if c.method == "self" and c.estimator is None:
        raise fault("lacks `estimator`, which the method `self` has")
    if c.method == "tracker" and c.estimator is not None:
        raise fault("belongs to self-calibration, not to the method `tracker`", "estimator")
    if c.method == "self" and (c.fit is None or c.observability is None):
        raise fault("lacks `fit` or `observability`, which the method `self` has")
    scaled = any(support.sensitivity is not None for support in c.supports)
    if c.convention != (CONVENTION_WITH_SENSITIVITY if scaled else CONVENTION):
        given = "some supports" if scaled else "no support"
        raise fault(f"does not fit: {given} have a `sensitivity`", "convention")


def _check_names(c: Calibration) -> None:
    if c.support_names != tuple(support.name for support in c.rig.supports):
        raise fault("are not those of the embedded rig, in its order", "supports")
    for index, (support, rig) in enumerate(zip(c.supports, c.rig.supports, strict=True)):
        if not support.determined and set(rig.axes) == {"x", "y", "z"}:
            raise fault("is missing, though the sensor lacks no axis", "supports", index)
    stand = tuple(support.name for support in c.supports if support.determined)
    if not stand:
        raise fault("have no rotation, none of them", "supports")
    if c.covariance.parameters != turn_parameters(stand):
        raise fault(
            f"must be {stand[0]}.rx, {stand[0]}.ry and so on, in the order of the supports",
            *("covariance", "parameters"),
        )
    _check_lists(c, stand)


def _check_lists(c: Calibration, stand: tuple[str, ...]) -> None:
    """Refuse a list per sensor that is not of those with a rotation, in their order."""
    sensors = f"{', '.join(stand)}, in this order, each once"
    for index, quantity in enumerate(c.taken_as_exact):
        if tuple(effect.name for effect in quantity.supports) != stand:
            raise fault(f"must be of {sensors}", "taken_as_exact", index, "supports", hint=ALTERED)
    if c.budget is not None:
        named = [(entry.support, entry.angle) for entry in c.budget.angles]
        if named != list(product(stand, ANGLES)):
            what = f"must be roll, pitch, yaw of {sensors}"
            raise fault(what, "budget", "angles", hint=ALTERED)


def _check_rows(c: Calibration) -> None:
    """Refuse a table that has not one row per support."""
    histogram = c.monte_carlo and c.monte_carlo.histogram
    tables: list[tuple[Any, tuple[str, ...], tuple[str | int, ...]]] = [
        (c.monte_carlo, ("rpy_std", "low", "high"), ("monte_carlo",)),
        (histogram, ("counts",), ("monte_carlo", "histogram")),
        (c.fit, ("channel_noise",), ("fit",)),
        (c.dwells, ("force",), ("dwells",)),
        *((one, ("zero", "zero_std"), ("campaigns", k)) for k, one in enumerate(c.campaigns)),
        *((one, ("rpy", "rpy_std"), ("methods", k)) for k, one in enumerate(c.methods or ())),
    ]
    n = len(c.supports)
    for table, names, place in tables:
        for name in names if table is not None else ():
            rows = getattr(table, name)
            if rows is not None and len(rows) != n:
                raise fault(f"must have a row per support, {n}, got {len(rows)}", *place, name)


def checked_covariance(
    rows: Sequence[Sequence[float]] | FloatArray, size: int, *place: str, mixed: bool = False
) -> FloatArray:
    """Return a matrix, which must be symmetric and positive semidefinite to rounding.

    mixed : its parameters have units of their own, and so each its own rounding.
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


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def check_rotation(support: Mounting, covariance: FloatArray, index: int) -> None:
    """Refuse a support whose rotation, angles, quaternion and uncertainties disagree.

    covariance : (3, 3), rad², of the support's rotation, perturbed in the BCS.
    """
    R, place = np.array(support.rotation), ("supports", index)
    if not np.allclose(R @ R.T, np.eye(3), rtol=0, atol=SAME) or np.linalg.det(R) < 0:
        what = "is not a rotation: not orthonormal, or det ≠ +1"
        raise fault(what, *place, "rotation", hint=ALTERED)
    _same(so3.from_rpy(support.rpy), R, *place, "rpy", what="the angles of `rotation`")
    turned = _from_quaternion(support.quaternion)
    _same(turned, R, *place, "quaternion_xyzw", what="the quaternion of `rotation`")
    if support.turn_std is not None:
        _same_std(support.turn_std, turn_std(covariance)[0], *place, "turn_std")
    if not so3.locked(R):
        variance = so3.rpy_variance(R[None], covariance)[0]
        _same_std(support.rpy_std, np.sqrt(np.maximum(variance, 0.0)), *place, "rpy_std")


def from_directions(
    nominal_rpy: Sequence[float], directions: dict[Any, tuple[float, float, float]]
) -> FloatArray:
    """Rotation (3, 3) next to the nominal mounting whose measured axes point along directions.

    What no axis shows stays as it is nominally: readings turned by it are the same.
    """
    R = so3.from_rpy(np.array(nominal_rpy))
    if len(directions) != 1:
        columns = [directions.get(axis, np.zeros(3)) for axis in "xyz"]
        return so3.project(np.stack(columns, axis=1)) if directions else R
    ((axis, towards),) = directions.items()
    own, beside = R.T["xyz".index(axis)], R.T["yzx".index(axis)]
    about = np.cross(own, towards)
    sine, cosine = np.linalg.norm(about), float(own @ np.array(towards))
    if sine < SAME:
        return R if cosine > 0 else so3.exp(np.pi * beside) @ R
    return np.asarray(so3.exp(np.arctan2(sine, cosine) * about / sine) @ R)


def _from_quaternion(q: tuple[float, float, float, float]) -> FloatArray:
    """Rotation of q = (x, y, z, w); no rotation where q is not of unit length."""
    v, w = np.array(q[:3]), np.float64(q[3])
    return np.asarray((w**2 - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * so3.hat(v))


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
        raise fault("does not contain `covariance`", "parameters", "matrix", hint=ALTERED)


def check_stated(c: Calibration) -> None:
    """Refuse a file whose zeros, load, intervals, budget or χ² disagree with what they follow from.

    Raises the model's fault, which names the place.
    """
    _check_intervals(c)
    _check_budget(c)
    _check_fit(c)
    if c.parameters is not None:
        given = calibrated_from(c.parameters, c.loaded_rig().rig, c.rotation)
        _check_state(c, given.state, np.sqrt(np.diagonal(given.covariance)))


def _check_state(c: Calibration, state: State, std: FloatArray) -> None:
    """Compare with the block of all parameters; std (P,), by it."""
    n, place = len(c.supports), layout(len(c.supports))
    for index, support in enumerate(c.supports):
        where = ("supports", index)
        own = np.array([value is not None for value in support.zero])
        _same(support.offset, np.where(own, state.zero[index], 0.0), *where, "zero")
        stated = [s for s, there in zip(support.zero_std, own, strict=True) if there]
        _same_std(stated, std[place["zero"]].reshape(n, 3)[index, own], *where, "zero_std")
        scale = np.eye(3) + symmetric(state.sensitivity)[index]
        _same(c.sensitivity[index], scale, *where, "sensitivity")
    mass, bary = c.terminal.mass, c.terminal.barycenter
    _same(mass.value, state.mass, "terminal", "mass", "value")
    _same_std([mass.std], std[place["mass"]], "terminal", "mass", "std")
    _same(bary.value, state.barycentre, "terminal", "barycenter", "value")
    _same_std(bary.std, std[place["barycentre"]], "terminal", "barycenter", "std")


def _check_intervals(c: Calibration) -> None:
    """An interval is that of the Monte Carlo, or ± k standard uncertainties of some dof."""
    trials = c.monte_carlo
    for index, support in enumerate(c.supports):
        mounting = support.mounting
        if mounting is None or None in support.rpy_std:
            continue
        low, high = np.array(mounting.interval.low), np.array(mounting.interval.high)
        if trials is not None:
            drawn = np.array([trials.low[index], trials.high[index]])
            if np.allclose([low, high], drawn, rtol=0, atol=SAME):
                continue
        half, coverage = (high - low) / 2, mounting.interval.coverage
        least, most = (
            coverage_factor(coverage, dof) * np.array(mounting.rpy_std) for dof in (np.inf, 1.0)
        )
        off = np.abs((low + high) / 2 - mounting.rpy)
        if np.any((off > SAME) | (half < least - SAME) | (half > most + SAME)):
            place = ("supports", index, "rpy_interval")
            raise fault("does not follow from `rpy` and `rpy_std`", *place, hint=ALTERED)


def _check_budget(c: Calibration) -> None:
    """The sources' variances add up to each angle's."""
    stds = {s.name: s.rpy_std for s in c.supports if None not in s.rpy_std}
    for index, angle in enumerate(c.budget.angles if c.budget is not None else ()):
        if angle.support in stds:
            stated = stds[angle.support][ANGLES.index(angle.angle)]
            total = np.sqrt(sum(angle.variance.values()))
            _same_std([stated], np.array([total]), "budget", "angles", index, "variance")


def _check_fit(c: Calibration) -> None:
    """p-value and Birge ratio follow from χ² and its degrees of freedom; campaigns add up to it."""
    if c.fit is None:
        return
    chi2, dof = c.fit.chi2, c.fit.dof
    if dof:
        _same(c.fit.p_value, chi2_sf(chi2, dof), "fit", "p_value")
        _same(c.fit.birge, np.sqrt(chi2 / dof), "fit", "birge")
    if c.campaigns:
        _same(chi2, sum(one.chi2 for one in c.campaigns), "fit", "chi2")
        _same(dof, sum(one.dof for one in c.campaigns), "fit", "dof")


def _same(
    stated: npt.ArrayLike,
    other: npt.ArrayLike,
    *place: str | int,
    what: str = "what the file says elsewhere",
) -> None:
    """Compare two statements of a value to rounding; a nanometre, a nanonewton."""
    if not np.allclose(stated, other, rtol=SAME, atol=SAME):
        raise fault(f"is not {what}", *place, hint=ALTERED)


def _same_std(stated: Sequence[float | None], other: FloatArray, *place: str | int) -> None:
    """Compare standard uncertainties; None is open, which a covariance cannot say."""
    values = np.array(stated, dtype=np.float64)  # None becomes no number
    known = np.isfinite(values)
    if not np.allclose(values[known], other[known], rtol=SAME_STD, atol=0):
        raise fault("does not follow from the covariance", *place, hint=ALTERED)
