"""Straightness and squareness of the NCPs' axes, from the residuals of their moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.registration import LARGEST_MEANINGFUL_STD, Registration, extend
from tdfscal.numerics.registration import register as solve
from tdfscal.records import FloatArray
from tdfscal.significance import POSITIONER_AXIS
from tdfscal.trackercal.judged_registration import SurveyFit, affine_columns


@dataclass(frozen=True, slots=True)
class AxisFault:
    """A significant departure of one axis of one NCP. size ± std: in `unit`."""

    support: str
    axis: str
    kind: str
    size: float
    std: float
    unit: str
    p_value: float

    def __str__(self) -> str:
        factor, unit = {"rad": (1e3, "mrad"), "1": (1e6, "ppm"), "m": (1e6, "µm")}[self.unit]
        return (
            f"{self.support}: {self.axis}: {self.kind} {self.size * factor:+.3g} ± "
            f"{self.std * factor:.2g} {unit}"
        )


@dataclass(frozen=True, slots=True)
class AxisTest:
    """One support's moves with axes of their own.

    scale : (3,), relative. squareness : (3,), rad, departure from 90° of yz, zx, xy. bow : (3,), m,
    largest departure of the x, y, z axis from straight over the travel. turn : (3,), rad, of this
    NCP's axes against the other NCPs', BCS. *_std: standard uncertainties. None where the moves do
    not tell.
    """

    support: str
    faults: tuple[AxisFault, ...] = ()
    turn: FloatArray | None = None
    turn_std: FloatArray | None = None
    scale: FloatArray | None = None
    scale_std: FloatArray | None = None
    squareness: FloatArray | None = None
    squareness_std: FloatArray | None = None
    bow: FloatArray | None = None


def examine_axes(moves: SurveyFit) -> tuple[AxisTest, ...]:
    """Fit each support's moves by themselves, rigidly and with axes of their own.

    An affine map has six parameters more than a rigid one: three scales and three squarenesses;
    a bow is a parabola across and along each axis. Each axis is tested by the parameters that
    are its own.
    """
    tests = 7 * len(moves.groups) * 3
    return tuple(_examine(moves, g, POSITIONER_AXIS / tests) for g in range(len(moves.groups)))


def _examine(moves: SurveyFit, g: int, limit: float) -> AxisTest:
    support, which = moves.groups[g], np.flatnonzero(moves.group == g)
    points, noise = moves.points.take(which), moves.noise.take(which)
    try:
        fit = solve(points.measured, points.reference, *noise.totals(len(which)))
    except TdfscalError:
        return AxisTest(
            support
        )  # too few moves of this support alone; the joint fit does not need them
    faults: list[AxisFault] = []
    servo = points.reference - points.reference.mean(axis=0)
    turn, turn_std = _turn(moves, fit, faults, support, limit)
    affine = extend(fit, np.einsum("ij,njq->niq", fit.rotation, affine_columns(servo)))
    if affine is None or fit.dof < 6:
        return AxisTest(support, tuple(faults), turn, turn_std)
    value, std = affine.value, np.sqrt(np.diag(affine.covariance))
    for k, (name, kind, unit) in enumerate(_AFFINE_NAMES):
        p = float(chi2_sf((value[k] / std[k]) ** 2, 1))
        if p < limit:
            faults.append(AxisFault(support, name, kind, float(value[k]), float(std[k]), unit, p))
    bow = _bow(fit, servo, support, limit, faults)
    each = (value[:3], std[:3], value[3:], std[3:])
    return AxisTest(support, tuple(faults), turn, turn_std, *each, bow)


_AFFINE_NAMES = (
    ("x axis", "scale", "1"),
    ("y axis", "scale", "1"),
    ("z axis", "scale", "1"),
    ("y against z axis", "squareness", "rad"),
    ("z against x axis", "squareness", "rad"),
    ("x against y axis", "squareness", "rad"),
)


def _bow(
    fit: Registration, servo: FloatArray, support: str, limit: float, faults: list[AxisFault]
) -> FloatArray | None:
    """Largest bow per axis; None where the moves do not tell bows from the affine map."""
    half = np.abs(servo).max(axis=0)
    if fit.dof < 6 + 9 + 3 or half.min() == 0:
        return None
    affine = affine_columns(servo)
    arc = (servo / half) ** 2
    bows = np.einsum("nk,ia->niak", arc, np.eye(3)).reshape(len(servo), 3, 9, order="F")
    columns = np.einsum("ij,njq->niq", fit.rotation, np.concatenate([affine, bows], axis=2))
    # Unit of a bow: m at the end of the travel; scaled so that a standard uncertainty of 1 is 1 mm.
    columns[:, :, 6:] *= 1e-3
    extension = extend(fit, columns)
    if extension is None:
        return None
    value, cov = extension.value[6:].reshape(3, 3), extension.covariance[6:, 6:]
    size = np.linalg.norm(value, axis=1) * 1e-3
    for k, axis in enumerate("xyz"):
        block = cov[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        p = float(chi2_sf(value[k] @ np.linalg.solve(block, value[k]), 3))
        if p < limit:
            std = float(np.sqrt(np.trace(block) / 3)) * 1e-3
            faults.append(AxisFault(support, f"{axis} axis", "bow", float(size[k]), std, "m", p))
    return np.asarray(size)


def _turn(
    moves: SurveyFit, fit: Registration, faults: list[AxisFault], support: str, limit: float
) -> tuple[FloatArray | None, FloatArray | None]:
    """Turn of one NCP's axes against the others'.

    The common rotation is the information-weighted mean of this support's own and the others',
    H d_common = H_own d_own + H_others d_others, from which the others' follows.
    """
    if len(moves.groups) < 2:
        return None, None
    R = moves.fit.rotation
    own, common = (np.linalg.inv(f.rotation_covariance) for f in (fit, moves.fit))
    others = common - own
    if np.linalg.eigvalsh(others)[0] <= LARGEST_MEANINGFUL_STD**-2:
        return None, None
    d = R.T @ np.linalg.solve(others, common @ so3.log(fit.rotation @ R.T))
    cov = R.T @ (fit.rotation_covariance + np.linalg.inv(others)) @ R
    p, std = float(chi2_sf(d @ np.linalg.solve(cov, d), 3)), np.sqrt(np.diag(cov))
    if p < limit:
        k = int(np.argmax(np.abs(d) / std))
        name, kind = f"all axes about {'xyz'[k]}", "turned against the other NCPs'"
        faults.append(AxisFault(support, name, kind, float(d[k]), float(std[k]), "rad", p))
    return d, std
