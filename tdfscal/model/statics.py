"""The measurement model, once: force and moment balance of the terminal at rest.

For every posture without contact (theory, section 2), with F_i = M_i f_i − b_i, γ = m g:

    e_F = Σ F_i + γ                                   = 0     N
    e_M = Σ ρ_i × F_i + ρ_m × γ                       = 0     N·m

where M_i = X_i (I + S_i)⁻¹, b_i = M_i z_i, ρ_i = R (r_i − c), ρ_m = R (r_m − c), and c is a fixed
point of the terminal near its barycentre. R is the rigid registration of the hinges on the servo
positions. Both equations are *linear* in the features ψ = (vec M_i, b_i, γ, (r_m − c) ⊗ γ) and,
to the first order that micrometres need, in the corrections of hinges and servo datums. A posture
is therefore a constant matrix Φ_k with e_k = Φ_k ψ, and all postures together a statistic whose
size does not depend on their number.

Shapes: n supports, K postures, q = 18 n + 12 features, P = 18 n + 6 parameters. State arrays may
carry leading batch axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.parameters import SYMMETRIC, State, gravity, layout, sensing, unmixing
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, Dwells, FloatArray, IntArray, Rig


def forces(state: State, reading: FloatArray) -> FloatArray:
    """F_i = X_i (I + S_i)⁻¹ (f_i − z_i) in the BCS, N; reading (..., K, n, 3)."""
    load = reading - state.zero[..., None, :, :]
    return np.asarray(np.einsum("...nab,...knb->...kna", sensing(state), load))


def register(hinge: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pose of the terminal: R (K, 3, 3) and T (K, 3) with R r_i + T ≈ p_i (Eq. 1).

    hinge (n, 3) in the LCS, position (K, n, 3) in the BCS, m; least squares over all n hinges.
    """
    r0, p0 = hinge.mean(axis=0), position.mean(axis=-2)
    R = so3.project(np.einsum("kni,nj->kij", position - p0[:, None], hinge - r0))
    return R, p0 - R @ r0


@dataclass(frozen=True, slots=True)
class Postures:
    """Static postures as the balance sees them.

    position, force : (K, n, 3), servo in the BCS (m), reading in the sensor frame (N).
    position_cov, force_cov : (K, n, 3, 3), all that does not average out included.
    moment_var : N²m², variance per axis of an additive moment (friction of the hinges).
    """

    position: FloatArray
    force: FloatArray
    position_cov: FloatArray
    force_cov: FloatArray
    moment_var: float

    def __len__(self) -> int:
        return len(self.force)

    def subset(self, keep: BoolArray | IntArray | slice) -> Postures:
        """Return the postures that keep (a mask, indices or a slice) selects."""
        arrays = ("position", "force", "position_cov", "force_cov")
        return replace(self, **{name: getattr(self, name)[keep] for name in arrays})


def postures(rig: Rig, dwells: Dwells) -> Postures:
    """Dwells with the rig's declared uncertainties added to those of their means."""
    eye = np.eye(3)
    return Postures(
        position=dwells.position,
        force=dwells.force,
        position_cov=dwells.position_cov + rig.declared.positioner**2 * eye,
        force_cov=dwells.force_cov + rig.declared.force_noise**2 * eye,
        moment_var=rig.declared.hinge_moment**2,
    )


@dataclass(frozen=True, slots=True)
class Balance:
    """All postures linearised at one state.

    design : (K, 6, q), Φ_k, rows e_F (N) and e_M (N·m, about the barycentre of `centre`), BCS.
    noise_force : (K, n, 6, 3), e = … + Σ noise_force · (reading noise).
    noise_turn : (K, 6, 3), e = … + noise_turn · (rotation error of the registered pose, rad).
    turn_cov : (K, 3, 3), rad², covariance of that rotation error.
    rotation : (K, 3, 3), pose R. arm : (K, n, 3), ρ_i, m, BCS.
    cov : (K, 6, 6), covariance of e.
    centre : (3,), c in the LCS. hinge, datum : the values about which ψ counts them.
    """

    design: FloatArray
    noise_force: FloatArray
    noise_turn: FloatArray
    turn_cov: FloatArray
    rotation: FloatArray
    arm: FloatArray
    cov: FloatArray
    centre: FloatArray
    hinge: FloatArray
    datum: FloatArray

    @property
    def wrench(self) -> FloatArray:
        """B_i = [I; [ρ_i]×], shape (K, n, 6, 3): e = Σ B_i F_i + …."""
        return wrench(self.arm)


def wrench(arm: FloatArray) -> FloatArray:
    """Force and moment (..., 6, 3) of a unit force at the lever arm (..., 3)."""
    matrix = np.empty((*arm.shape[:-1], 6, 3))
    matrix[..., :3, :] = np.eye(3)
    matrix[..., 3:, :] = so3.hat(arm)
    return matrix


def balance(posture: Postures, state: State, centre: FloatArray, g: float) -> Balance:
    """Linearise the postures' balance equations at state (no batch axes); g in m/s²."""
    n, K = state.n, len(posture)
    eye = np.eye(3)
    R, _ = register(state.hinge, posture.position - state.datum)
    arm = np.einsum("kab,nb->kna", R, state.hinge - centre)
    arm_m = R @ (state.barycentre - centre)
    F = forces(state, posture.force)
    weight = state.mass * gravity(state, g)

    # Rotation of the registered pose for a displacement ε_i of the positions: δφ = Σ Pφ_i ε_i.
    spoke = so3.hat(arm - arm.mean(axis=1, keepdims=True))
    inertia = np.einsum("knca,kncb->kab", spoke, spoke)
    P_turn = np.linalg.solve(inertia[:, None], spoke)
    # Turning the pose turns all arms: (δφ × ρ) × F = [F]× [ρ]× δφ.
    A = (so3.hat(F) @ so3.hat(arm)).sum(axis=1) + so3.hat(weight) @ so3.hat(arm_m)

    B = wrench(arm)
    design = np.zeros((K, 6, 18 * n + 12))
    kron = np.einsum("ac,knd->knacd", eye, posture.force).reshape(K, n, 3, 9)
    design[:, :, : 9 * n] = np.moveaxis(B @ kron, 1, 2).reshape(K, 6, 9 * n)
    design[:, :, 9 * n : 12 * n] = -np.moveaxis(B, 1, 2).reshape(K, 6, 3 * n)
    design[:, :3, 12 * n : 12 * n + 3] = eye
    columns = np.swapaxes(so3.hat(np.swapaxes(R, 1, 2)), 1, 2)  # [:, :, a, b] = (R e_a) × e_b
    design[:, 3:, 12 * n + 3 : 12 * n + 12] = columns.reshape(K, 3, 9)
    turned = -A[:, None] @ P_turn
    moved = -so3.hat(F) @ R[:, None] + turned @ R[:, None]
    design[:, 3:, 12 * n + 12 : 15 * n + 12] = np.moveaxis(moved, 1, 2).reshape(K, 3, 3 * n)
    design[:, 3:, 15 * n + 12 :] = np.moveaxis(turned, 1, 2).reshape(K, 3, 3 * n)

    noise_force = B @ sensing(state)
    noise_turn = np.zeros((K, 6, 3))
    noise_turn[:, 3:] = A
    turn_cov = np.einsum("kiab,kibc,kidc->kad", P_turn, posture.position_cov, P_turn)
    cov = np.einsum("kiab,kibc,kidc->kad", noise_force, posture.force_cov, noise_force)
    cov += noise_turn @ turn_cov @ np.swapaxes(noise_turn, 1, 2)
    cov[:, 3:, 3:] += posture.moment_var * eye
    return Balance(
        design=design,
        noise_force=noise_force,
        noise_turn=noise_turn,
        turn_cov=turn_cov,
        rotation=R,
        arm=arm,
        cov=cov,
        centre=centre,
        hinge=state.hinge,
        datum=state.datum,
    )


def features(state: State, at: Balance, g: float) -> FloatArray:
    """ψ (q,) of the state; hinge and datum enter as deviations from the linearisation."""
    M, weight = sensing(state), state.mass * gravity(state, g)
    parts = [
        M,
        np.einsum("nab,nb->na", M, state.zero),
        weight,
        np.outer(state.barycentre - at.centre, weight),
        state.hinge - at.hinge,
        state.datum - at.datum,
    ]
    return np.concatenate([np.ravel(part) for part in parts])


def features_jacobian(state: State, at: Balance, g: float) -> FloatArray:
    """∂ψ/∂(step of `retract`), (q, P), of a state without batch axes."""
    n, place = state.n, layout(state.n)
    jac = np.zeros((18 * n + 12, 18 * n + 6))
    M, each = sensing(state), np.arange(n)
    turned = so3.hat(np.eye(3)) @ M[:, None]  # (n, 3, 3, 3): [e_j]× M
    strained = -M[:, None] @ SYMMETRIC @ unmixing(state.sensitivity)[:, None]  # (n, 6, 3, 3)
    # Views of the block (features of the sensor, its parameters) with one axis per sensor.
    m_rows = jac[: 9 * n].reshape(n, 9, -1)
    b_rows = jac[9 * n : 12 * n].reshape(n, 3, -1)
    for group, change in (("rotation", turned), ("sensitivity", strained)):
        size = change.shape[1]
        columns = place[group].start + size * each[:, None] + np.arange(size)
        m_part = np.swapaxes(change.reshape(n, size, 9), 1, 2)
        b_part = np.swapaxes((change @ state.zero[:, None, :, None])[..., 0], 1, 2)
        np.put_along_axis(m_rows, np.repeat(columns[:, None], 9, axis=1), m_part, axis=2)
        np.put_along_axis(b_rows, np.repeat(columns[:, None], 3, axis=1), b_part, axis=2)
    columns = place["zero"].start + 3 * each[:, None] + np.arange(3)
    np.put_along_axis(b_rows, np.repeat(columns[:, None], 3, axis=1), M, axis=2)

    w, wr = slice(12 * n, 12 * n + 3), slice(12 * n + 3, 12 * n + 12)
    gvec, lever = gravity(state, g), state.barycentre - at.centre
    tilt = np.array([*state.tilt, 0.0])
    d_tilt = -so3.hat(gvec) @ so3.left_jacobian(tilt)[:, :2]  # d(exp(t) g₀) = (J dt) × g
    mass, bary = place["mass"].start, place["barycentre"]
    jac[w, mass], jac[wr, mass] = gvec, np.outer(lever, gvec).ravel()
    jac[w, place["tilt"]] = state.mass * d_tilt
    jac[wr, place["tilt"]] = state.mass * np.einsum("a,bj->abj", lever, d_tilt).reshape(9, 2)
    jac[wr, bary] = state.mass * np.einsum("aj,b->abj", np.eye(3), gvec).reshape(9, 3)
    h = 12 * n + 12
    jac[h : h + 3 * n, place["hinge"]] = np.eye(3 * n)
    jac[h + 3 * n :, place["datum"]] = np.eye(3 * n)
    return jac
