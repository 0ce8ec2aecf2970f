"""The contact wrench against closed forms and the simulator's truth."""

from dataclasses import replace
from typing import Any

import numpy as np

from tdfscal.model.parameters import gravity
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, UncertainValue
from tdfscal.wrench.contact_wrench import covariance, wrenches
from tdfscal.wrench.samples_in_motion import motion, poses

from .held_out import HELD, RIG, world

FORCE, MOMENT = (30.0, -20.0, 45.0), (8.0, -6.0, 4.0)


def test_wrench_is_newtons_law_written_out() -> None:
    """Readings by which a gain and crosstalk went, too, which are undone before the rotation."""
    given, dwells = world(1).given[0], world(1).held(0)
    voigt = np.array([[0.01, -0.02, 0.015, 0.003, -0.004, 0.005]] * 3)
    given = replace(given, state=replace(given.state, sensitivity=voigt))
    xx, yy, zz, yz, xz, xy = voigt[0]
    gain = np.eye(3) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    s = given.state
    found = wrenches(given, dwells.start, dwells.position, dwells.force).value
    R, _ = register(s.hinge, dwells.position - s.datum)
    G = float(s.mass) * gravity(s, RIG.gravity)
    for k in range(HELD):
        load = np.linalg.solve(gain, (dwells.force[k] - s.zero).T).T
        L = [R[k].T @ s.rotation[i] @ load[i] for i in range(3)]
        weight = R[k].T @ G
        force = -np.sum(L, axis=0) - weight
        moment = -sum(np.cross(s.hinge[i], L[i]) for i in range(3)) - np.cross(s.barycentre, weight)
        # Poses are good to 1e-10 rad, and 5 kN turn with them.
        assert np.abs(found[k] - [*force, *moment]).max() < 5e-7


def test_open_zeros_leave_the_uncertainty_open() -> None:
    given, dwells = world(100).given[0], world(100).held(0)
    unknown = np.zeros_like(given.open)
    unknown[9:12] = True
    cov = covariance(replace(given, open=unknown), dwells.position, dwells.force)
    assert np.all(np.isinf(np.diagonal(cov, axis1=1, axis2=2)[:, :3]))


def test_inertial_terms_are_the_rate_of_momentum() -> None:
    rate, N = 1000.0, 2001
    t = np.arange(N) / rate
    inertia = np.array([[60.0, 2.0, -3.0], [2.0, 70.0, 1.0], [-3.0, 1.0, 90.0]])
    rig = replace(RIG, inertia=UncertainValue.exact(inertia))
    given = replace(world(100).given[0], rig=rig)
    s, m = given.state, float(given.state.mass)

    def pose_at(u: Any) -> tuple[FloatArray, FloatArray]:
        turn = np.stack([0.05 * np.sin(3 * u), 0.04 * np.cos(2 * u), 0.06 * np.sin(u)], axis=-1)
        path = np.stack([0.02 * np.sin(4 * u), 0.03 * np.cos(3 * u), 0.01 * u**2], axis=-1)
        return so3.exp(turn), path

    def momentum(u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Linear momentum, and angular momentum about the BCS' origin, by complex step."""
        h = 1e-30
        R, T = pose_at(u)
        Rc, Tc = pose_at(u + 1j * h)
        dR, dT = Rc.imag / h, Tc.imag / h
        spin = dR @ np.swapaxes(R, 1, 2)
        w = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        r = R @ s.barycentre
        p = m * (dT + np.cross(w, r))
        about_o = (R @ inertia @ np.swapaxes(R, 1, 2) @ w[..., None])[..., 0] + m * np.cross(r, dT)
        return p, about_o + np.cross(T, p)

    R, T = pose_at(t)
    h = 1e-4
    (p1, l1), (p0, l0) = momentum(t + h), momentum(t - h)
    force, torque = (p1 - p0) / (2 * h), (l1 - l0) / (2 * h)
    weight = m * gravity(s, rig.gravity)
    need = force - weight
    # Moments about the LCS origin, which moves: those about the BCS' origin less T × F.
    turn = torque - np.cross(T, force) - np.cross(R @ s.barycentre, weight)
    arm = np.einsum("kab,nb->kna", R, s.hinge)
    grasp = np.concatenate([np.broadcast_to(np.eye(3), (N, 3, 3, 3)), so3.hat(arm)], axis=2)
    grasp = np.moveaxis(grasp, 1, 2).reshape(N, 6, 9)
    F = (np.linalg.pinv(grasp) @ np.concatenate([need, turn], axis=1)[..., None]).reshape(N, 3, 3)
    reading = np.einsum("nba,knb->kna", s.rotation, F) + s.zero
    position = arm + T[:, None] + s.datum
    R, T = poses(s.hinge, position - s.datum)
    moving = motion(R, T, 1 / rate, 100)
    with_inertia = wrenches(given, t, position, reading, rotation=R, moving=moving).value
    at_rest = wrenches(given, t, position, reading, rotation=R).value
    inner = slice(100, -100)
    # A cubic over ±0.1 s misses f''''·h²·const of 4 rad/s motions: below 2 % of the inertia.
    assert np.abs(at_rest[inner]).max() > 100.0
    assert np.abs(with_inertia[inner]).max() < 0.02 * np.abs(at_rest[inner]).max()
    shorter = motion(R, T, 1 / rate, 20)
    better = wrenches(given, t, position, reading, rotation=R, moving=shorter).value
    assert np.abs(better[inner]).max() < 0.002 * np.abs(at_rest[inner]).max()
