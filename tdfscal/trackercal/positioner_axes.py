"""Scale and squareness of the NCPs' axes, from the residuals of their moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.findings import Finding, Value
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.registration import LARGEST_MEANINGFUL_STD, Registration, extend
from tdfscal.numerics.registration import register as solve
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

    An affine map has six parameters more than a rigid one: three scales and three squarenesses.
    """
    names = moves.points.groups
    limit = POSITIONER_AXIS / (7 * len(names))
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
