"""The balance of every block in the frequency domain, linear in the features of the model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model import dynamics, statics
from tdfscal.model.dynamics import Moving
from tdfscal.model.parameters import State, gravity
from tdfscal.model.pose import register
from tdfscal.model.statics import Balance, Postures
from tdfscal.model.zero_motion import ZeroMotion, zero_motion
from tdfscal.motioncal.blocks import Block, ComplexArray
from tdfscal.motioncal.streams import Slow
from tdfscal.records import FloatArray, Rig
from tdfscal.wrench.kinematics import Motion, Poses, motion

#: Below this angular speed, rad/s, a hinge sticks and its friction is whatever it has to be.
_STICK = 5.0e-4
#: Instants on either side that a local cubic takes in for angular speeds.
_HALF = 3
#: Shift of the poses for the derivative by the delay, s.
_SHIFT = 5.0e-3


@dataclass(frozen=True, slots=True)
class BlockDesign:
    """One block at one linearisation.

    design : (F, 6, q + 12) complex, e = design · (statics' and motion's features); its first
    three rows in N/√Hz, the others in N·m/√Hz.
    unit_force, unit_turn : (6, 6), mean covariance of e for white noise of 1 N on every force
    component, and of 1 m on every servo coordinate through the registered pose.
    lever : (n, 6, 3, 6, 3), mean of B_i ⊗ B_i, B_i the wrench of a unit force.
    """

    block: Block
    design: ComplexArray
    unit_force: FloatArray
    unit_turn: FloatArray
    lever: FloatArray


def shifted(slow: Slow, rows: slice, delay: float) -> FloatArray:
    """Servo positions (N, n, 3) at the instants at which the forces of these rows were felt."""
    position = slow.position[rows]
    if delay == 0.0:
        return position
    from scipy.interpolate import CubicSpline

    time = slow.time[rows]
    moved = CubicSpline(time, position)(np.clip(time - delay, time[0], time[-1]))
    return np.asarray(moved)


def block_design(
    rig: Rig, slow: Slow, block: Block, state: State, moving: Moving
) -> tuple[BlockDesign, Balance]:
    """Linearise one block at a state.

    Returns its design, and the static balance of one instant, which holds what the features
    count from.
    """
    centre = state.barycentre
    position = shifted(slow, block.index, moving.delay)
    force = slow.force[block.index]
    N, n = force.shape[:2]
    unit = np.broadcast_to(np.eye(3), (N, n, 3, 3))
    observed = Postures(
        position=position,
        force=force,
        position_cov=unit,
        force_cov=unit,
        moment_var=0.0,
        approach=np.zeros((N, 3)),  # friction in motion is a feature of its own
        measured=rig.axes,
        motion=_subset(drifting(rig, slow), block.index),
    )
    g = rig.gravity
    at = statics.balance(observed, state, centre, g)
    plain = block.transform(at.design)
    moved = _moving_columns(block, at.rotation, position, state, centre)
    before, after = (
        _residual(rig, slow, block, state, moving, moving.delay + shift)
        for shift in (-_SHIFT, _SHIFT)
    )
    delayed = ((after - before) / (2 * _SHIFT))[..., None]
    weight = block.taper[0] ** 2 / np.sum(block.taper[0] ** 2)
    B = at.wrench
    turn = at.noise_turn @ at.turn_cov @ np.swapaxes(at.noise_turn, 1, 2)
    through = np.einsum("k,knab,kncb->ac", weight, at.noise_force, at.noise_force)
    result = BlockDesign(
        block=block,
        design=np.concatenate([plain, moved, delayed], axis=2),
        unit_force=through,
        unit_turn=np.einsum("k,kab->ab", weight, turn),
        lever=np.einsum("k,knra,knsb->nrasb", weight, B, B, optimize=True),
    )
    return result, statics.balance(observed.subset(slice(0, 1)), state, centre, g)


def drifting(rig: Rig, slow: Slow) -> ZeroMotion | None:
    """How the zeros may move over the instants; a random walk stands in the spectrum instead."""
    return zero_motion(replace(rig.drift, walk=0.0), slow.time, slow.temperature, rig.n)


def _subset(motion: ZeroMotion | None, rows: slice) -> ZeroMotion | None:
    return None if motion is None else motion.subset(rows)


def _moving_columns(
    block: Block, R: FloatArray, position: FloatArray, state: State, centre: FloatArray
) -> ComplexArray:
    """Columns of m, m (r_m − c), I_c and τ, (F, 6, 11)."""
    F = len(block.frequency)
    out = np.zeros((F, 6, 11), dtype=np.complex128)
    place, turning, speed_up = _kinematics(block, R, position, state, centre)
    out[:, :3, 0] = -block.transform(place, derivative=2)
    out[:, :3, 1:4] = -block.transform(R, derivative=2)
    arm_rate = np.cross(np.swapaxes(R, 1, 2), speed_up[:, None], axis=2)  # (R e_a) × a
    out[:, 3:, 1:4] = -block.transform(np.swapaxes(arm_rate, 1, 2))
    out[:, 3:, 4:10] = -block.transform(dynamics.spin_momentum(R, turning), derivative=1)
    out[:, 3:, 10] = -state.n * block.transform(stuck(turning))
    return out


def stuck(turning: FloatArray) -> FloatArray:
    """ω/|ω| (N, 3), smooth near rest."""
    return np.asarray(turning / np.sqrt(np.sum(turning**2, axis=1, keepdims=True) + _STICK**2))


def _kinematics(
    block: Block, R: FloatArray, position: FloatArray, state: State, centre: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place of c less its mean (m), angular velocity (rad/s) and acceleration (m/s²), BCS."""
    middle = state.hinge.mean(axis=0)
    T = (position - state.datum).mean(axis=1) - R @ middle
    place = T + R @ centre
    found: Motion | None = motion(Poses(R, place), block.step, _HALF)
    assert found is not None  # blocks are longer than the window
    turning = np.einsum("kab,kb->ka", R, found.turning)
    speed_up = np.einsum("kab,kb->ka", R, found.acceleration)
    return place - place.mean(axis=0), turning, speed_up


def _residual(
    rig: Rig, slow: Slow, block: Block, state: State, moving: Moving, delay: float
) -> FloatArray:
    """E (F, 6) of one block with the poses shifted by another delay."""
    centre = state.barycentre
    position = shifted(slow, block.index, delay)
    R, _ = register(state.hinge, position - state.datum)
    arm = np.einsum("kab,nb->kna", R, state.hinge - centre)
    F = statics.forces(state, slow.force[block.index])
    e = np.zeros((len(F), 6))
    e[:, :3] = F.sum(axis=1) + state.mass * gravity(state, rig.gravity)
    e[:, 3:] = np.cross(arm, F).sum(axis=1)
    values = dynamics.features(state, moving, centre, moving.delay)[:11]
    return np.asarray(
        block.transform(e) + _moving_columns(block, R, position, state, centre) @ values
    )
