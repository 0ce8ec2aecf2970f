"""A calibration as those see it who use it: every parameter of the rig with one covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.parameters import State, layout, nominal, prior_std
from tdfscal.records import BoolArray, FloatArray, Rig, UncertainValue


@dataclass(frozen=True, slots=True)
class Calibrated:
    """The estimate in use, with P = 18 n + 9 parameters ordered as in `parameters.layout`:
    zeros as they were at the first posture, however they moved afterwards.

    covariance : (P, P), of the step of `parameters.retract` from the estimate to the truth; SI
    units, rotations as left perturbations in the BCS, rad; zero rows where exactly known or open.
    open : (P,), nothing is known of these parameters one by one.
    joint : the covariance is that of all parameters together; else only the rotations' own block
    is joint and the rest is taken as independent, which overstates the contact wrench's
    uncertainty after a self-calibration.
    """

    rig: Rig
    state: State
    covariance: FloatArray
    open: BoolArray
    joint: bool

    @property
    def root(self) -> FloatArray:
        """U (P, r) with U Uᵀ the covariance, in as many columns as it has rank."""
        scale = np.sqrt(np.diagonal(self.covariance))
        used = np.flatnonzero(scale)
        unit = self.covariance[np.ix_(used, used)] / np.outer(scale[used], scale[used])
        values, vectors = np.linalg.eigh(unit)
        keep = values > len(used) * np.finfo(float).eps * values.max(initial=0.0)
        root = np.zeros((len(scale), int(keep.sum())))
        root[used] = scale[used, None] * vectors[:, keep] * np.sqrt(values[keep])
        return root


def about_point(given: Calibrated, point: FloatArray) -> Calibrated:
    """The same with the LCS moved parallel to itself to a point (3,), m, of the present one.

    Moments and the inertia are then about that point.
    """
    state, rig = given.state, given.rig
    inertia = rig.inertia
    if inertia is not None:
        r, m = state.barycentre, float(state.mass)
        about_old, about_new = (v @ v * np.eye(3) - np.outer(v, v) for v in (r, r - point))
        inertia = replace(inertia, value=inertia.value + m * (about_new - about_old))
    moved = replace(
        rig,
        hinge=rig.hinge - point,
        barycentre=replace(rig.barycentre, value=rig.barycentre.value - point),
        inertia=inertia,
    )
    at = replace(state, hinge=state.hinge - point, barycentre=state.barycentre - point)
    return replace(given, rig=moved, state=at)


def redrawn(given: Calibrated, **own: tuple[FloatArray, FloatArray]) -> Calibrated:
    """The same with quantities that are others now, independent of all that was calibrated.

    own : `zero`, `mass` or `barycentre` with its value as in the state, and its covariance (q, q),
    ∞ on the diagonal where nothing is known.
    """
    place, covariance, unknown = layout(given.rig.n), given.covariance.copy(), given.open.copy()
    for name, (_, cov) in own.items():
        where = place[name]
        unknown[where] = np.isinf(np.diagonal(cov))
        covariance[where], covariance[:, where] = 0.0, 0.0
        covariance[where, where] = np.where(np.isinf(cov), 0.0, cov)
    values = {name: value for name, (value, _) in own.items()}
    return replace(given, state=replace(given.state, **values), covariance=covariance, open=unknown)


def with_rotations(covariance: FloatArray, turns: int, rotations: FloatArray) -> FloatArray:
    """Covariance (P, P) whose first block is replaced, the others' given the first kept.

    With x = A r + ν, A = C_xr C_rr⁻¹ and ν independent of r, only r changes.
    """
    own, cross = covariance[:turns, :turns], covariance[turns:, :turns]
    slope = np.linalg.solve(own, cross.T).T
    given = covariance[turns:, turns:] - slope @ cross.T
    mixed = slope @ rotations
    out = np.block([[rotations, mixed.T], [mixed, given + mixed @ slope.T]])
    return np.asarray((out + out.T) / 2)


def independent(
    rig: Rig,
    rotation: FloatArray,
    rotation_covariance: FloatArray,
    *,
    zero: UncertainValue | None = None,
    mass: UncertainValue | None = None,
    barycentre: UncertainValue | None = None,
    sensitivity: FloatArray | None = None,
) -> Calibrated:
    """Rotations with their covariance, everything else independent of them.

    True after a laser-tracker calibration. zero, mass, barycentre : as in `Rig`, default the
    rig's. sensitivity : (n, 6), S as xx, yy, zz, yz, xz, xy, default 0.
    """
    start, place = nominal(rig), layout(rig.n)
    zero, mass, barycentre = zero or rig.zero, mass or rig.mass, barycentre or rig.barycentre
    std = prior_std(rig)
    std[place["rotation"]] = 0.0
    std[place["zero"]] = zero.std.ravel()
    std[place["mass"]] = mass.std
    std[place["barycentre"]] = barycentre.std
    unknown = np.isinf(std)
    covariance = np.diag(np.where(unknown, 0.0, std) ** 2)
    covariance[place["rotation"], place["rotation"]] = rotation_covariance
    return Calibrated(
        rig=rig,
        state=replace(
            start,
            rotation=rotation,
            zero=zero.value,
            sensitivity=start.sensitivity if sensitivity is None else sensitivity,
            mass=mass.value,
            barycentre=barycentre.value,
        ),
        covariance=covariance,
        open=unknown,
        joint=False,
    )
