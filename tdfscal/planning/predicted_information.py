"""What postures would tell, by the measurement model of the estimator."""

from __future__ import annotations

import numpy as np

from tdfscal.acceptance import coverage_radius
from tdfscal.frozen import record
from tdfscal.model.parameters import State, furthest, layout, nominal, prior_std, sensing
from tdfscal.model.statics import Postures, balance, features_jacobian, internal_modes
from tdfscal.numerics import so3
from tdfscal.numerics.information import inverse
from tdfscal.planning.candidates import Candidates, Limits, hanging
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.selfcal.estimator import Fit, at_state

#: What an unknown zero, and the friction of hinges, are at most, N: they are no constants of the
#: rig.
_WIDE = {"zero": 1e4, "friction": 1e3}


@record
class Sight:
    """How postures are seen: at a state, with a noise.

    noise : N per axis, standard uncertainty of a posture's mean force; declared noise adds to it.
    active : (P,), which parameters are free. wide : (p,), width of ignorance per free parameter.
    open : (n,), sensors without all axes whose mounting no posture shows.
    """

    rig: Rig
    state: State
    noise: float
    active: BoolArray
    wide: FloatArray
    open: BoolArray

    @classmethod
    def of(cls, rig: Rig, noise: float) -> Sight:
        """At the nominal mounting."""
        active, wide, place = prior_std(rig) > 0, furthest(rig.n), layout(rig.n)
        for group, most in _WIDE.items():
            wide[place[group]] = most
        none = np.zeros(rig.n, dtype=np.bool_)
        return cls(rig, nominal(rig), noise, active, wide[active], none)

    def prior(self) -> FloatArray:
        """Information (p, p) held before any posture: the rig file's priors, and ignorance."""
        level = np.eye(3)[None]
        rows = self.seen((self.rig.hinge @ level), hanging(self.rig, level)[1]).prior_jacobian
        return np.asarray(rows.T @ rows + np.diag(self.wide**-2))

    def observed(self, place: FloatArray, force: FloatArray) -> Postures:
        """Postures as the sensors would see them without error; place, force (K, n, 3), BCS."""
        rig, state = self.rig, self.state
        M = np.linalg.inv(sensing(state))
        shape = (*force.shape, 3)
        declared = rig.declared
        force_var = self.noise**2 + declared.force_noise**2
        return Postures(
            position=place + state.datum,
            force=np.einsum("nab,knb->kna", M, force) + state.zero,
            position_cov=np.broadcast_to(declared.positioner**2 * np.eye(3), shape),
            force_cov=np.broadcast_to(force_var * np.eye(3), shape),
            moment_var=declared.hinge_moment**2,
            friction_sense=np.zeros((len(force), 3)),
            measured=rig.axes,
        )

    def seen(self, place: FloatArray, force: FloatArray) -> Fit:
        """Linearise such postures."""
        observed = self.observed(place, force)
        return at_state(self.rig, observed, self.state, np.ones(len(observed)))

    def rows(self, postures: Candidates) -> FloatArray:
        """Whitened Jacobians (K, 6, p)."""
        fit = self.seen(postures.place, postures.force)
        return np.asarray(fit.at.whitener @ fit.jacobian)

    def scatter(self, postures: Candidates, limits: Limits) -> FloatArray:
        """Information (K, p, p) expected of unplanned internal forces, posture by posture.

        The Jacobian is linear in the forces, so Σ J(u)ᵀ W J(u) over the internal modes u, each
        with the standard deviation that the NCPs' repeatability gives it, is that expectation.
        """
        size = limits.repeatability_force(self.rig)
        p = int(self.active.sum())
        out = np.zeros((len(postures), p, p))
        if size == 0.0:
            return out
        base = self.seen(postures.place, postures.force)
        arm, _ = hanging(self.rig, postures.rotation)
        for mode in np.moveaxis(internal_modes(arm), 1, 0):
            moved = self.seen(postures.place, postures.force + size * mode)
            J = base.at.whitener @ (moved.jacobian - base.jacobian)
            out += np.swapaxes(J, 1, 2) @ J
        return out


@record
class Forecast:
    """Uncertainty to expect of a set of postures.

    rpy_std : (n, 3), rad; NaN where no posture would show the mounting.
    contact_force, contact_torque : N and N·m per axis (3,), of the contact wrench at the posture
    asked for, LCS, about the LCS origin; None where none was.
    """

    rpy_std: FloatArray
    contact_force: FloatArray | None = None
    contact_torque: FloatArray | None = None

    @property
    def mean(self) -> float:
        """Mean standard uncertainty of the angles that can be known, rad."""
        return float(np.nanmean(self.rpy_std))

    @property
    def largest(self) -> float:
        """Largest of them, rad."""
        return float(np.nanmax(self.rpy_std))


def contact_expanded(of: Forecast) -> tuple[float, float] | None:
    """Expanded uncertainties of contact force, N, and torque, N·m; None where none was asked for.

    As the quality gate has them, their components taken as uncorrelated.
    """
    if of.contact_force is None or of.contact_torque is None:
        return None
    force, torque = (coverage_radius(np.diag(v**2)) for v in (of.contact_force, of.contact_torque))
    return force, torque


def contact_excess(rig: Rig, of: Forecast) -> float:
    """Largest of the contact wrench's expanded uncertainties over the rig file's limit of it."""
    expected = contact_expanded(of) or ()
    limits = (limit for *_, limit in rig.acceptance.contact_limits)
    each = (size / limit for size, limit in zip(expected, limits, strict=False) if limit)
    return max(each, default=0.0)


def angle_rows(sight: Sight) -> FloatArray:
    """Rows (3n, p) of roll, pitch, yaw of every sensor by the free parameters, rad.

    Those of open sensors are 0.
    """
    n = sight.rig.n
    L = np.zeros((3 * n, len(sight.wide)))
    for i, block in enumerate(so3.rpy_jacobian(sight.state.rotation)):
        L[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = 0.0 if sight.open[i] else block
    return L


def wrench_rows(sight: Sight, rpy: tuple[float, float, float]) -> FloatArray:
    """Rows (6, p) of the contact wrench at a posture, N and N·m about the LCS origin, LCS.

    The terminal hangs there on the smallest forces that carry it.
    """
    rig = sight.rig
    R = so3.from_rpy(np.array(rpy))
    _, force = hanging(rig, R[None])
    place = (rig.hinge @ R.T)[None]
    at = balance(sight.observed(place, force), sight.state, np.zeros(3), rig.gravity)
    jac = at.design[0] @ features_jacobian(sight.state, at, rig.gravity)[:, sight.active]
    return np.concatenate([R.T @ jac[:3], R.T @ jac[3:]])


def forecast(
    sight: Sight,
    postures: Candidates,
    limits: Limits,
    held: FloatArray,
    at: tuple[float, float, float] | None = None,
) -> Forecast:
    """Uncertainty to expect of postures on top of the information held (p, p).

    Unplanned internal forces count by their expected information.
    """
    known = held + sight.scatter(postures, limits).sum(axis=0)
    seen = sight.seen(postures.place, postures.force)
    J = seen.at.whitener @ seen.jacobian
    C = inverse(known + information(J))
    turns = slice(0, 3 * sight.rig.n)
    # With the noise in the levers: C is the inverse of the true information Λ, while the score
    # varies by Λ + N.
    cov = C[turns, turns]
    cov = cov + cov @ seen.faked_information() @ cov
    angle_var = variances(cov, angle_rows(sight)[:, turns])
    std = np.where(sight.open[:, None], np.nan, np.sqrt(angle_var).reshape(-1, 3))
    if at is None:
        return Forecast(std)
    return Forecast(std, *np.sqrt(variances(C, wrench_rows(sight, at))).reshape(2, 3))


def scatter_of(seen: Postures, rig: Rig) -> float:
    """Quadratic mean, N per axis, of the postures' force noise beyond what the rig declares."""
    variance = np.diagonal(seen.force_cov, axis1=2, axis2=3)[:, rig.axes].mean()
    return float(np.sqrt(max(0.0, variance - rig.declared.force_noise**2)))


def information(J: FloatArray) -> FloatArray:
    """Information Σ JᵀJ (p, p) of candidates' rows J (N, m, p)."""
    return np.asarray(np.einsum("kmp,kmq->pq", J, J))


def variances(C: FloatArray, L: FloatArray) -> FloatArray:
    """Diagonal (r,) of L C Lᵀ for a covariance C (p, p) and L (r, p)."""
    return np.asarray(np.einsum("rp,pq,rq->r", L, C, L))
