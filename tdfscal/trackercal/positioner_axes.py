"""Straightness and squareness of the NCPs' axes, from the residuals of their moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.findings import Finding, Value
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.registration import LARGEST_MEANINGFUL_STD, Registration, extend
from tdfscal.numerics.registration import register as solve
from tdfscal.records import FloatArray
from tdfscal.significance import POSITIONER_AXIS
from tdfscal.trackercal.judged_registration import SurveyFit, affine_columns

_AFFINE = (
    ("x axis", "scale", "1"),
    ("y axis", "scale", "1"),
    ("z axis", "scale", "1"),
    ("y against z axis", "squareness", "rad"),
    ("z against x axis", "squareness", "rad"),
    ("x against y axis", "squareness", "rad"),
)


def _fault(
    support: str, axis: str, kind: str, size: float, std: float, unit: str, p: float
) -> Finding:
    """A departure of one axis of one NCP, size ± std, and its probability by chance."""
    values: dict[str, Value] = {"axis": axis, "kind": kind, "std": std}
    return Finding("positioner-axis-faulty", (support,), size, unit, p, values=values)


def examine_axes(moves: SurveyFit) -> tuple[Finding, ...]:
    """Fit each support's moves by themselves, and return what departs significantly.

    An affine map has six parameters more than a rigid one: three scales and three squarenesses;
    a bow is a parabola across and along each axis. Each axis is tested by the parameters that
    are its own.
    """
    names = moves.points.groups
    limit = POSITIONER_AXIS / (7 * len(names) * 3)
    tests = (test for name in names for test in _tests(moves, name))
    return tuple(test for test in tests if test.p_value is not None and test.p_value < limit)


def _tests(moves: SurveyFit, support: str) -> Iterator[Finding]:
    """Every departure of one support's axes that its moves tell."""
    which = moves.points.indices(support)
    points, noise = moves.points.take(which), moves.noise.take(which)
    try:
        fit = solve(points.measured.xyz, points.reference.xyz, *noise.totals(len(which)))
    except TdfscalError:
        return  # too few moves of this support alone; the joint fit does not need them
    yield from _turn(moves, fit, support)
    servo = points.reference.xyz - points.reference.xyz.mean(axis=0)
    affine = extend(fit, np.einsum("ij,njq->niq", fit.rotation, affine_columns(servo)))
    if affine is None or fit.dof < 6:
        return
    stds = np.sqrt(np.diag(affine.covariance))
    for (axis, kind, unit), value, std in zip(_AFFINE, affine.value, stds, strict=True):
        p = float(chi2_sf((value / std) ** 2, 1))
        yield _fault(support, axis, kind, float(value), float(std), unit, p)
    yield from _bows(fit, servo, support)


def _bows(fit: Registration, servo: FloatArray, support: str) -> Iterator[Finding]:
    """Bow of each axis, where the moves tell bows from the affine map."""
    half = np.abs(servo).max(axis=0)
    if fit.dof < 6 + 9 + 3 or half.min() == 0:
        return
    arc = (servo / half) ** 2
    bows = np.einsum("nk,ia->niak", arc, np.eye(3)).reshape(len(servo), 3, 9, order="F")
    columns = np.concatenate([affine_columns(servo), bows], axis=2)
    columns = np.einsum("ij,njq->niq", fit.rotation, columns)
    # Unit of a bow: m at the end of the travel; scaled so that a standard uncertainty of 1 is 1 mm.
    columns[:, :, 6:] *= 1e-3
    extension = extend(fit, columns)
    if extension is None:
        return
    for k, axis in enumerate("xyz"):
        own = slice(6 + 3 * k, 9 + 3 * k)
        value, block = extension.value[own], extension.covariance[own, own]
        p = float(chi2_sf(value @ np.linalg.solve(block, value), 3))
        size, std = float(np.linalg.norm(value)), float(np.sqrt(np.trace(block) / 3))
        yield _fault(support, f"{axis} axis", "bow", 1e-3 * size, 1e-3 * std, "m", p)


def _turn(moves: SurveyFit, fit: Registration, support: str) -> Iterator[Finding]:
    """Turn of one NCP's axes against the others', about the axis where it is most certain.

    The common rotation is the information-weighted mean of this support's own and the others',
    H d_common = H_own d_own + H_others d_others, from which the others' follows.
    """
    R = moves.fit.rotation
    own, common = (np.linalg.inv(f.rotation_covariance) for f in (fit, moves.fit))
    others = common - own
    if len(moves.points.groups) < 2 or np.linalg.eigvalsh(others)[0] <= LARGEST_MEANINGFUL_STD**-2:
        return
    d = R.T @ np.linalg.solve(others, common @ so3.log(fit.rotation @ R.T))
    cov = R.T @ (fit.rotation_covariance + np.linalg.inv(others)) @ R
    p, std = float(chi2_sf(d @ np.linalg.solve(cov, d), 3)), np.sqrt(np.diag(cov))
    k = int(np.argmax(np.abs(d) / std))
    axis, kind = f"all axes about {'xyz'[k]}", "turned against the other NCPs'"
    yield _fault(support, axis, kind, float(d[k]), float(std[k]), "rad", p)
