"""The measurement model, once: force and moment balance of the terminal at rest.

For every posture without contact (theory, section 2), with F_i = M_i f_i − b_i, γ = m g:

    e_F = Σ F_i + γ                                   = 0     N
    e_M = Σ ρ_i × F_i + ρ_m × γ                       = 0     N·m

where M_i = X_i (I + S_i)⁻¹, b_i = M_i z_i, ρ_i = R (r_i − c), ρ_m = R (r_m − c), and c is a fixed
point of the terminal near its barycentre. R is the rigid registration of the hinges on the servo
positions. Both equations are *linear* in the features ψ = (vec M_i, b_i, γ, (r_m − c) ⊗ γ) and,
to the first order that micrometres need, in the corrections of hinges, servo datums and of the
compliance between encoder and hinge. A posture is therefore a constant matrix Φ_k with
e_k = Φ_k ψ, and all postures together a statistic whose size does not depend on their number.

A component that a sensor does not measure is a reading with infinite variance: a free force of
the posture. The rows of a posture are projected on what no free force reaches, so that it costs
equations, not parameters (theory, section 10).

Shapes: n supports, K postures, G functions by which zeros move, q = 18 n + 15 + 3 n G features,
P parameters (`parameters.layout`). State arrays may carry leading batch axes.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.model.parameters import (
    SYMMETRIC,
    State,
    gravity,
    layout,
    parameter_count,
    sensing,
    unmixing,
    with_motions,
)
from tdfscal.model.postures import Postures, forces, postures, register, zeros
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import free_values, whitener
from tdfscal.records import BoolArray, FloatArray, IntArray

__all__ = [
    "Balance",
    "Postures",
    "balance",
    "features",
    "features_jacobian",
    "forces",
    "free",
    "postures",
    "wrench",
]

#: Rounds in which forces that nobody measures and the lean of the terminal agree.
_FILLINGS = 2


@record
class Balance:
    """All postures linearised at one state.

    seen : the postures; readings that no sensor gives stand as the balance demands them.
    design : (K, 6, q), Φ_k, rows e_F (N) and e_M (N·m, about the barycentre of `centre`), BCS.
    noise_force : (K, n, 6, 3), e = … + Σ noise_force · (reading noise).
    noise_turn : (K, 6, 3), e = … + noise_turn · (rotation error of the registered pose, rad).
    turn : (K, n, 3, 3), that rotation for a displacement of each position, rad/m. turn_cov :
    (K, 3, 3), rad², its covariance.
    rotation : (K, 3, 3), pose R. arm : (K, n, 3), ρ_i, m, BCS.
    centre : (3,), c in the LCS. hinge, datum, compliance : values about which ψ counts them.
    """

    seen: Postures
    design: FloatArray
    noise_force: FloatArray
    noise_turn: FloatArray
    turn: FloatArray
    turn_cov: FloatArray
    rotation: FloatArray
    arm: FloatArray
    centre: FloatArray
    hinge: FloatArray
    datum: FloatArray
    compliance: FloatArray

    @cached_property
    def cov(self) -> FloatArray:
        """Covariance (K, 6, 6) of e by noise alone, free forces apart."""
        seen, B, turn = self.seen, self.noise_force, self.noise_turn
        both = seen.measured[:, :, None] & seen.measured[:, None, :]
        cov = (B @ np.where(both, seen.force_cov, 0.0) @ np.swapaxes(B, 2, 3)).sum(axis=1)
        cov += turn @ self.turn_cov @ np.swapaxes(turn, 1, 2)
        cov[:, 3:, 3:] += seen.moment_var * np.eye(3)
        return np.asarray(cov)

    @property
    def wrench(self) -> FloatArray:
        """B_i = [I; [ρ_i]×], shape (K, n, 6, 3): e = Σ B_i F_i + …."""
        return wrench(self.arm)

    @property
    def free(self) -> FloatArray:
        """Wrench (K, 6, m) of a unit force along each component that is not measured."""
        return free(self.noise_force, self.seen.measured)

    @property
    def whitener(self) -> FloatArray:
        """V (K, 6, 6) with V e white in `rows` directions and 0 along free forces."""
        return self._white[0]

    @property
    def rows(self) -> IntArray:
        """Number (K,) of directions of e that no free force reaches."""
        return self._white[1]

    @cached_property
    def _white(self) -> tuple[FloatArray, IntArray]:
        return whitener(self.cov, self.free)

    @cached_property
    def information(self) -> FloatArray:
        """VᵀV (K, 6, 6): the inverse of `cov` where all is measured."""
        V = self.whitener
        return np.asarray(np.swapaxes(V, 1, 2) @ V)


def wrench(arm: FloatArray) -> FloatArray:
    """Force and moment (..., 6, 3) of a unit force at the lever arm (..., 3)."""
    matrix = np.empty((*arm.shape[:-1], 6, 3))
    matrix[..., :3, :] = np.eye(3)
    matrix[..., 3:, :] = so3.hat(arm)
    return matrix


def balance(posture: Postures, state: State, centre: FloatArray, g: float) -> Balance:
    """Linearise the postures' balance equations at state (no batch axes); g in m/s².

    Readings that no sensor gives are first put to what the balance demands. With these the
    derivative of the projected rows by the rotations is exact (variable projection); their
    covariance says how much noise stands in those levers.
    """
    missing = ~posture.measured
    sensor, axis = np.nonzero(missing)
    together = np.argwhere(sensor[:, None] == sensor[None])
    for _ in range(_FILLINGS if missing.any() else 0):
        at = _linearised(posture, state, centre, g)
        e = at.design @ features(with_motions(state, posture.motions), at, g)
        value, variance = free_values(at.cov, at.free, e)
        force, force_cov = posture.force.copy(), posture.force_cov.copy()
        force[:, missing] += value
        for a, b in together:
            force_cov[:, sensor[a], axis[a], axis[b]] = variance[:, a, b]
        posture = replace(posture, force=force, force_cov=force_cov)
    return _linearised(posture, state, centre, g)


def _linearised(posture: Postures, state: State, centre: FloatArray, g: float) -> Balance:
    n, K = state.n, len(posture)
    F = np.einsum("nab,knb->kna", sensing(state), posture.force - zeros(state, posture))
    give = state.compliance[[0, 0, 1]] * F
    R, _ = register(state.hinge, posture.position - state.datum - give)
    arm = np.einsum("kab,nb->kna", R, state.hinge - centre)
    arm_m = R @ (state.barycentre - centre)
    weight = state.mass * gravity(state, g)
    # Rotation of the registered pose for a displacement ε_i of the positions: δφ = Σ Pφ_i ε_i.
    spoke = so3.hat(arm - arm.mean(axis=1, keepdims=True))
    all_spokes = spoke.reshape(K, 3 * n, 3)  # also of no posture at all
    inertia = np.swapaxes(all_spokes, 1, 2) @ all_spokes
    P_turn = np.linalg.inv(inertia)[:, None] @ spoke
    # Turning the pose turns all arms: (δφ × ρ) × F = (ρ Fᵀ − (F·ρ) I) δφ.
    levers = np.swapaxes(arm, 1, 2) @ F + arm_m[:, :, None] * weight
    A = levers - np.trace(levers, axis1=1, axis2=2)[:, None, None] * np.eye(3)

    B = wrench(arm)
    noise_force = B @ sensing(state)
    noise_turn = np.zeros((K, 6, 3))
    noise_turn[:, 3:] = A
    turn_cov = (P_turn @ posture.position_cov @ np.swapaxes(P_turn, 2, 3)).sum(axis=1)
    return Balance(
        seen=posture,
        design=_design(posture, R, F, B, -A[:, None] @ P_turn),
        noise_force=noise_force,
        noise_turn=noise_turn,
        turn=P_turn,
        turn_cov=turn_cov,
        rotation=R,
        arm=arm,
        centre=centre,
        hinge=state.hinge,
        datum=state.datum,
        compliance=state.compliance,
    )


def _design(
    posture: Postures, R: FloatArray, F: FloatArray, B: FloatArray, turned: FloatArray
) -> FloatArray:
    """Φ_k (K, 6, q); turned : (K, n, 3, 3), moment for a displacement of each position."""
    K, n = F.shape[:2]
    design = np.zeros((K, 6, 18 * n + 15 + 3 * n * posture.motions))
    of_forces = np.moveaxis(B, 1, 2)
    by_readings = design[:, :, : 9 * n].reshape(K, 6, n, 3, 3)
    np.multiply(of_forces[..., None], posture.force[:, None, :, None], out=by_readings)
    of_zeros = design[:, :, 9 * n : 12 * n]
    np.negative(of_forces, out=of_zeros.reshape(K, 6, n, 3))
    design[:, :3, 12 * n : 12 * n + 3] = np.eye(3)
    columns = np.swapaxes(so3.hat(np.swapaxes(R, 1, 2)), 1, 2)  # [:, :, a, b] = (R e_a) × e_b
    design[:, 3:, 12 * n + 3 : 12 * n + 12] = columns.reshape(K, 3, 9)
    moved = (turned - so3.hat(F)) @ R[:, None]
    design[:, 3:, 12 * n + 12 : 15 * n + 12] = np.moveaxis(moved, 1, 2).reshape(K, 3, 3 * n)
    design[:, 3:, 15 * n + 12 : 18 * n + 12] = np.moveaxis(turned, 1, 2).reshape(K, 3, 3 * n)
    # The encoder stands C F_i ahead of the hinge: a datum that follows the load.
    given = np.einsum("knra,kna->kr", turned, F)
    vertical = np.einsum("knr,kn->kr", turned[..., 2], F[..., 2])
    design[:, 3:, 18 * n + 12] = given - vertical
    design[:, 3:, 18 * n + 13] = vertical
    design[:, 3:, 18 * n + 14] = -n * posture.friction_sense  # − Σ_i ω/|ω| (theory, section 8)
    if posture.motion is not None:
        by_motion = (
            of_zeros.reshape(K, 6, 1, n, 3)
            * np.moveaxis(posture.motion.value, 1, 2)[:, None, :, :, None]
        )
        design[:, :, 18 * n + 15 :] = by_motion.reshape(K, 6, -1)
    return design


def free(noise_force: FloatArray, measured: BoolArray) -> FloatArray:
    """Wrench (K, 6, m) of a unit force along each component that is not measured."""
    return np.asarray(np.moveaxis(noise_force, 2, 1)[:, :, ~measured])


def features(state: State, at: Balance, g: float) -> FloatArray:
    """ψ (..., q) of the state; hinge and datum enter as deviations from the linearisation."""
    M, lead = sensing(state), state.rotation.shape[:-3]
    weight = np.asarray(state.mass)[..., None] * gravity(state, g)
    parts = [
        M,
        np.einsum("...nab,...nb->...na", M, state.zero),
        weight,
        (state.barycentre - at.centre)[..., :, None] * weight[..., None, :],
        state.hinge - at.hinge,
        state.datum - at.datum,
        state.compliance - at.compliance,
        state.friction,
        np.einsum("...nab,...gnb->...gna", M, state.drift),
    ]
    # No drift at all has no entries, and no length to guess.
    return np.concatenate(
        [np.reshape(part, (*lead, int(np.prod(np.shape(part)[len(lead) :])))) for part in parts],
        axis=-1,
    )


def features_jacobian(state: State, at: Balance, g: float) -> FloatArray:
    """∂ψ/∂(step of `retract`), (q, P), of a state without batch axes."""
    n, motions = state.n, state.motions
    place = layout(n, motions)
    jac = np.zeros((18 * n + 15 + 3 * n * motions, parameter_count(n, motions)))
    M, h = sensing(state), 12 * n + 12
    turned = so3.hat(np.eye(3)) @ M[:, None]  # (n, 3, 3, 3): [e_j]× M
    strained = -M[:, None] @ SYMMETRIC @ unmixing(state.sensitivity)[:, None]  # (n, 6, 3, 3)
    # Rows of M_i Z, Z the zero and then the amplitudes by which it moves.
    starts = [9 * n, *(h + 6 * n + 3 + 3 * n * k for k in range(motions))]
    groups = [place["zero"].start, *(place["drift"].start + 3 * n * k for k in range(motions))]
    for i in range(n):
        for group, change in (("rotation", turned[i]), ("sensitivity", strained[i])):
            size = len(change)
            columns = slice(place[group].start + size * i, place[group].start + size * (i + 1))
            jac[9 * i : 9 * i + 9, columns] = change.reshape(size, 9).T
            for start, Z in zip(starts, (state.zero, *state.drift), strict=True):
                jac[start + 3 * i : start + 3 * i + 3, columns] = (change @ Z[i]).T
        for start, first in zip(starts, groups, strict=True):
            jac[start + 3 * i : start + 3 * i + 3, first + 3 * i : first + 3 * i + 3] = M[i]

    w, wr = slice(12 * n, 12 * n + 3), slice(12 * n + 3, h)
    gvec, lever = gravity(state, g), state.barycentre - at.centre
    tilt = np.array([*state.tilt, 0.0])
    d_tilt = -so3.hat(gvec) @ so3.left_jacobian(tilt)[:, :2]  # d(exp(t) g₀) = (J dt) × g
    mass, bary = place["mass"].start, place["barycentre"]
    jac[w, mass], jac[wr, mass] = gvec, np.outer(lever, gvec).ravel()
    jac[w, place["tilt"]] = state.mass * d_tilt
    jac[wr, place["tilt"]] = state.mass * np.einsum("a,bj->abj", lever, d_tilt).reshape(9, 2)
    jac[wr, bary] = state.mass * np.einsum("aj,b->abj", np.eye(3), gvec).reshape(9, 3)
    for group in ("hinge", "datum", "compliance", "friction"):
        size = place[group].stop - place[group].start
        jac[h : h + size, place[group]] = np.eye(size)
        h += size
    return jac


def grasp(arm: FloatArray) -> FloatArray:
    """G (..., 6, 3n): net force and moment of forces at the lever arms (..., n, 3)."""
    blocks = np.moveaxis(wrench(arm), -3, -2)  # (..., 6, n, 3)
    return np.asarray(blocks.reshape(*blocks.shape[:-2], -1))


def carrying(arm: FloatArray, arm_m: FloatArray, weight: FloatArray) -> FloatArray:
    """Smallest forces (..., n, 3), N, that carry a weight (3,) at the arm arm_m (..., 3).

    F = −Gᵀ (G Gᵀ)⁻¹ w (Eq. 18 corrected). Equally stiff NCPs share the weight so.
    """
    G = grasp(arm)
    down = np.broadcast_to(weight, arm_m.shape)
    w = np.concatenate([down, np.cross(arm_m, down)], axis=-1)[..., None]
    Gt = np.swapaxes(G, -1, -2)
    return np.asarray((-Gt @ np.linalg.solve(G @ Gt, w)).reshape(arm.shape))


def internal_modes(arm: FloatArray) -> FloatArray:
    """Orthonormal internal forces (..., 3n − 6, n, 3): G u = 0."""
    G = grasp(arm - arm.mean(axis=-2, keepdims=True))
    _, _, Vt = np.linalg.svd(G, full_matrices=True)
    return np.asarray(Vt[..., 6:, :].reshape(*arm.shape[:-2], -1, *arm.shape[-2:]))


def internal_part(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Forces (..., n, 3) less what they exert as a whole at the lever arms (..., n, 3)."""
    G = grasp(arm)
    Gt = np.swapaxes(G, -1, -2)
    flat = force.reshape(*force.shape[:-2], -1, 1)
    return np.asarray((flat - Gt @ np.linalg.solve(G @ Gt, G @ flat)).reshape(force.shape))


def to_origin(at: Balance) -> FloatArray:
    """Matrices (K, 6, 6) that move a balance's wrench e, BCS, from c to the LCS origin."""
    moved = np.tile(np.eye(6), (len(at.rotation), 1, 1))
    moved[:, 3:, :3] = so3.hat(at.rotation @ at.centre)
    return moved
