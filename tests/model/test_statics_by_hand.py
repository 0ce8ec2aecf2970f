"""The balance against Newton's law written out posture by posture, its noise against scatter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal import simulation
from tdfscal.model.parameters import State, nominal
from tdfscal.model.postures import Postures, ZeroMotion, friction_senses, postures, register
from tdfscal.model.statics import balance, features
from tdfscal.numerics import least_squares, so3
from tdfscal.records import DeclaredUncertainty, Drift, FloatArray
from tdfscal.simulation import Options

G = 9.81
RNG = np.random.default_rng(29)
RIG = simulation.make_rig(4)
K = 6
SIZES = {
    "zero": 2.0,
    "sensitivity": 0.02,
    "mass": 3.0,
    "barycentre": 0.05,
    "hinge": 1e-3,
    "datum": 1e-3,
    "tilt": 0.05,
    "compliance": 1e-9,
    "friction": 0.3,
    "drift": 0.1,
}


def random_state() -> State:
    """A state of four supports and one slope of the zeros, away from every special value."""
    base = nominal(RIG, 1)
    moved = {
        name: getattr(base, name) + size * RNG.normal(size=np.shape(getattr(base, name)))
        for name, size in SIZES.items()
    }
    rotation = so3.exp(0.3 * RNG.normal(size=(4, 3))) @ base.rotation
    return replace(base, rotation=rotation, **moved)


STATE = random_state()
TURN = Rotation.from_rotvec(0.2 * RNG.normal(size=(K, 3)))


def seen() -> Postures:
    """Rigid postures whose servos stand where the loaded encoders show them."""
    force = 1e3 * RNG.normal(size=(K, 4, 3))
    elapsed = np.repeat(np.linspace(0.0, 5.0, K)[:, None, None], 4, axis=1)
    root = 0.3 * RNG.normal(size=(K, 4, 3, 3))
    where = 1e-5 * RNG.normal(size=(K, 4, 3, 3))
    at = Postures(
        position=np.zeros((K, 4, 3)),
        force=force,
        position_cov=where @ np.swapaxes(where, 2, 3),
        force_cov=root @ np.swapaxes(root, 2, 3),
        moment_var=0.2,
        friction_sense=np.array([Rotation.random(random_state=k).as_rotvec() for k in range(K)]),
        measured=np.ones((4, 3), dtype=np.bool_),
        motion=ZeroMotion(("time",), elapsed, np.ones(1)),
    )
    F = written_out(at)
    lateral, vertical = STATE.compliance
    give = np.array([lateral, lateral, vertical]) * F
    hinge = np.stack([turn.apply(STATE.hinge) for turn in TURN])
    return replace(at, position=hinge + RNG.normal(size=(K, 1, 3)) + STATE.datum + give)


def written_out(at: Postures) -> FloatArray:
    """Forces in the base, one reading at a time."""
    F = np.empty((K, 4, 3))
    assert at.motion is not None
    for k in range(K):
        for i in range(4):
            xx, yy, zz, yz, xz, xy = STATE.sensitivity[i]
            S = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            zero = STATE.zero[i] + at.motion.value[k, i, 0] * STATE.drift[0, i]
            F[k, i] = STATE.rotation[i] @ np.linalg.solve(np.eye(3) + S, at.force[k, i] - zero)
    return F


AT = seen()
CENTRE = np.array([0.1, -0.2, 0.3])


def tilted_weight() -> FloatArray:
    tilt = Rotation.from_rotvec([*STATE.tilt, 0.0])
    return np.asarray(float(STATE.mass) * tilt.apply([0, 0, -G]))


def test_residual_is_newtons_law() -> None:
    """Moments about the point `centre` of the terminal, friction against the turn."""
    found = balance(AT, STATE, CENTRE, G)
    e = found.design @ features(STATE, found, G)
    F, W = written_out(AT), tilted_weight()
    for k in range(K):
        R = TURN[k]
        force = F[k].sum(axis=0) + W
        arms = R.apply(STATE.hinge - CENTRE)
        moment = np.cross(arms, F[k]).sum(axis=0) + np.cross(R.apply(STATE.barycentre - CENTRE), W)
        moment -= 4 * float(STATE.friction) * AT.friction_sense[k]
        assert np.abs(e[k] - [*force, *moment]).max() < 1e-8
    assert np.allclose(found.rotation, TURN.as_matrix(), rtol=0, atol=1e-13)
    assert np.allclose(found.arm[0], TURN[0].apply(STATE.hinge - CENTRE), rtol=0, atol=1e-13)


def test_covariance_of_the_residual_part_by_part() -> None:
    """Readings through their lever arms; friction as a moment, added; nothing without noise."""
    silent = replace(
        AT,
        force_cov=np.zeros_like(AT.force_cov),
        position_cov=np.zeros_like(AT.position_cov),
        moment_var=0.0,
    )
    assert not balance(silent, STATE, CENTRE, G).cov.any()
    friction = balance(replace(silent, moment_var=0.2), STATE, CENTRE, G).cov
    assert np.allclose(friction, np.diag([0, 0, 0, 0.2, 0.2, 0.2]), rtol=0, atol=1e-15)
    read = balance(replace(silent, force_cov=AT.force_cov), STATE, CENTRE, G).cov
    for k in range(K):
        total = np.zeros((6, 6))
        for i, arm in enumerate(TURN[k].apply(STATE.hinge - CENTRE)):
            for axis in np.eye(3):
                # One unit of a reading, made a force and a moment as in `written_out`.
                xx, yy, zz, yz, xz, xy = STATE.sensitivity[i]
                S = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
                root = np.linalg.cholesky(AT.force_cov[k, i])
                f = STATE.rotation[i] @ np.linalg.solve(np.eye(3) + S, root @ axis)
                w = np.concatenate([f, np.cross(arm, f)])
                total += np.outer(w, w)
        assert np.allclose(read[k], total, rtol=0, atol=1e-10 * np.abs(total).max())


def test_noise_of_the_positions_is_the_scatter_that_it_makes() -> None:
    """Many copies of one posture with drawn positions: covariance of the residual by χ²."""
    draws, one = 4000, AT.subset(slice(0, 1))
    root = np.linalg.cholesky(one.position_cov[0])
    noise = np.einsum("nab,knb->kna", root, np.random.default_rng(1).normal(size=(draws, 4, 3)))
    many = one.subset(np.zeros(draws, dtype=np.int64))
    at = balance(one, STATE, CENTRE, G)
    quiet = replace(one, force_cov=np.zeros_like(one.force_cov), moment_var=0.0)
    stated = balance(quiet, STATE, CENTRE, G).cov[0]
    moved = balance(replace(many, position=many.position + noise), STATE, CENTRE, G)
    e = moved.design @ features(STATE, moved, G) - at.design @ features(STATE, at, G)
    assert not stated[:3].any()  # a shifted or turned pose bears no force
    drawn, stated = e[:, 3:].T @ e[:, 3:] / draws, stated[3:, 3:]
    L = np.linalg.cholesky(stated)
    white = np.linalg.solve(L, np.linalg.solve(L, drawn).T)
    assert np.abs(white - np.eye(3)).max() < 5 * np.sqrt(2 / draws)


def test_readings_that_no_sensor_gives_are_of_no_consequence() -> None:
    """Whatever stands there, and however certain it is called."""
    measured = np.ones((4, 3), dtype=np.bool_)
    measured[1, 0] = measured[3, 2] = False
    one = replace(AT, measured=measured)
    junk = replace(one, force=np.where(measured, AT.force, 1e4 * RNG.normal(size=AT.force.shape)))
    first, second = (balance(p, STATE, CENTRE, G) for p in (one, junk))
    e = [
        np.linalg.norm((p.whitener @ (p.design @ features(STATE, p, G))[..., None])[..., 0], axis=1)
        for p in (first, second)
    ]
    assert np.allclose(e[0], e[1], rtol=1e-6, atol=0)
    assert np.array_equal(first.rows, np.full(K, 4))
    # What is filled in leaves little along the free forces, of their own uncertainty.
    value, variance = least_squares.free_values(
        first.cov, first.free, first.design @ features(STATE, first, G)
    )
    assert (np.abs(value) < 0.2 * np.sqrt(np.diagonal(variance, axis1=1, axis2=2))).all()
    pair = np.ones((4, 3), dtype=np.bool_)
    pair[2, :2] = False
    filled = balance(replace(AT, measured=pair), STATE, CENTRE, G)
    unbalanced = filled.design @ features(STATE, filled, G)
    _, variance = least_squares.free_values(filled.cov, filled.free, unbalanced)
    own = filled.seen.force_cov[:, 2, :2, :2]
    scale = np.sqrt(np.einsum("kaa,kbb->kab", variance, variance))
    assert (np.abs(own - variance) < 0.02 * scale).all()


def test_postures_are_reached_along_their_last_turn() -> None:
    """Still, still, about x, squeezed there, back about −x, about y."""
    turns = [[0, 0, 0], [0, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0.05, 0, 0], [0.05, 0.2, 0]]
    R = Rotation.from_rotvec(turns)
    found = friction_senses(R.as_matrix())
    last = (R[5] * R[4].inv()).as_rotvec()
    expected = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [-1, 0, 0], last / np.linalg.norm(last)]
    assert np.allclose(found, expected, rtol=0, atol=1e-12)
    assert not friction_senses(R[:2].as_matrix()).any()
    assert not friction_senses(R[:1].as_matrix()).any()


def test_dwells_get_what_the_rig_file_declares() -> None:
    declared = DeclaredUncertainty(positioner=1e-5, force_noise=0.4, hinge_moment=0.3)
    axes = np.ones((4, 3), dtype=np.bool_)
    axes[2, 1] = False
    rig = replace(RIG, declared=declared, axes=axes, drift=Drift(time=0.1))
    batch = simulation.simulate_dwells(rig, Options(), np.random.default_rng(4), 1)
    dwells = batch.dwells(0)
    found = postures(rig, dwells)
    eye = np.eye(3)
    assert found.moment_var == pytest.approx(0.09)
    excess = found.position_cov - dwells.position_cov
    assert np.allclose(excess, 1e-10 * eye, rtol=0, atol=1e-18)
    assert np.array_equal(found.force, np.where(axes, dwells.force, 0.0))
    grown = found.force_cov - dwells.force_cov
    assert np.allclose(grown[:, [0, 1, 3]], 0.16 * eye, rtol=0, atol=1e-12)
    assert not found.force_cov[:, 2, 1].any()
    assert not found.force_cov[:, 2, :, 1].any()
    assert found.motions == 1
    assert found.motion is not None
    middle = (dwells.start + dwells.end) / 2
    assert np.allclose(found.motion.value[:, 0, 0], middle - middle[0], rtol=0, atol=1e-9)
    R, _ = register(rig.hinge, dwells.position)
    assert np.array_equal(found.friction_sense, friction_senses(R))
    some = found.subset(np.arange(len(found)) > 2)
    assert len(some) == len(found) - 3
    assert np.array_equal(some.motion.value, found.motion.value[3:])  # type: ignore[union-attr]
    assert np.array_equal(some.friction_sense, found.friction_sense[3:])
