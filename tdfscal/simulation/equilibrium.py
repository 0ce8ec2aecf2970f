"""A rigid terminal on elastic carriages: where it is driven, where it rests, what holds it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.errors import NotConvergedError
from tdfscal.frozen import record
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import faults, rotations
from tdfscal.simulation.options import Moment, Options, carriage_stiffness
from tdfscal.simulation.truth import Truth, draw_truths, off_centre

BALANCE = 1.0e-10
MAX_STEPS = 30
GIVES_WAY = 0.1  # m
STIFFER = "make the carriages stiffer, or the loads smaller"


@record
class Pose:
    """Poses of the terminal: rotation (..., 3, 3), LCS → BCS; translation (..., 3), m."""

    rotation: FloatArray
    translation: FloatArray

    def place(self, point: FloatArray) -> FloatArray:
        """Points of the terminal, (..., n, 3) in the LCS, in the BCS."""
        turned = point @ np.swapaxes(self.rotation, -1, -2)
        return np.asarray(turned + self.translation[..., None, :], dtype=np.float64)


@record
class Load:
    """What acts on the terminal besides the hinges and its weight, per posture.

    contact : (..., K, 2, 3), force (N) and moment (N·m) about the LCS origin, LCS components.
    friction : (..., K, 3), N·m, moment of the hinges in the BCS.
    """

    contact: FloatArray
    friction: FloatArray


@record
class Equilibrium:
    """The terminal at rest: its pose and the force of each NCP on it, (..., K, n, 3), N, BCS."""

    pose: Pose
    force: FloatArray


def settle(truth: Truth, stand: FloatArray, load: Load, start: Pose) -> Equilibrium:
    """Static equilibrium of every posture at once, by Newton's method on SE(3).

    Carriage i stands at `stand` (..., K, n, 3), m, BCS, and pulls its hinge towards there with
    F_i = −K_i (h_i − stand_i). At rest the forces and the moments about the LCS origin of
    springs, weight and load vanish. The step is a translation and a rotation exp([φ]×) from the
    left. truth : leading axes (...) as those of stand before K.

    Raises NotConvergedError where no rest is found (a rig too soft to stand).
    """
    hinge = truth.hinge[..., None, :, :]
    stiffness = truth.stiffness[..., None, :, :, :]
    weight = (truth.mass[..., None] * truth.gravity)[..., None, :]
    R, T = start.rotation, start.translation
    for _ in range(MAX_STEPS):
        arm = hinge @ np.swapaxes(R, -1, -2)
        bary = np.einsum("...kij,...j->...ki", R, truth.barycentre)
        stretch = arm + T[..., None, :] - stand
        force = -np.einsum("...ij,...j->...i", stiffness, stretch)
        contact = np.einsum("...ij,...cj->...ci", R, load.contact)
        net_force = force.sum(axis=-2) + weight + contact[..., 0, :]
        net_moment = (
            np.cross(arm, force).sum(axis=-2)
            + np.cross(bary, np.broadcast_to(weight, bary.shape))
            + contact[..., 1, :]
            + load.friction
        )
        # Net force over the sum of forces, net moment over that times the largest lever.
        size = np.linalg.norm(force, axis=-1).sum(axis=-1) + np.linalg.norm(weight, axis=-1) + 1.0
        lever = np.linalg.norm(arm, axis=-1).max(axis=-1)
        imbalance = np.maximum(
            np.linalg.norm(net_force, axis=-1) / size,
            np.linalg.norm(net_moment, axis=-1) / (size * lever),
        )
        slope = _slope(stiffness, arm, force, bary, weight)
        if np.all(imbalance < BALANCE):
            _check_standing(stretch, slope)
            return Equilibrium(Pose(R, T), force)
        step = np.linalg.solve(slope, np.concatenate([net_force, net_moment], axis=-1)[..., None])
        T = T + step[..., :3, 0]
        R = rotations.exp(step[..., 3:, 0]) @ R
    raise NotConvergedError(
        f"the terminal finds no rest in {int(np.sum(~(imbalance < BALANCE)))} postures",
        hint=STIFFER,
    )


def _check_standing(stretch: FloatArray, slope: FloatArray) -> None:
    """Refuse a rest that is no posture of a machine: sunk, or about to topple."""
    if np.max(np.abs(stretch)) > GIVES_WAY:
        raise NotConvergedError(
            f"a carriage gives way by {np.max(np.abs(stretch)):.2g} m", hint=STIFFER
        )
    # Stable where the energy's second derivative is positive definite.
    if np.min(np.linalg.eigvalsh(0.5 * (slope + np.swapaxes(slope, -1, -2)))) <= 0.0:
        raise NotConvergedError("the terminal topples", hint=STIFFER)


def _slope(
    stiffness: FloatArray, arm: FloatArray, force: FloatArray, bary: FloatArray, weight: FloatArray
) -> FloatArray:
    """How much net force and moment a small (translation, rotation) takes away, (..., 6, 6).

    The springs' and the weight's turning is exact; the contact's is left out, which costs at
    most a step.
    """
    out = springs(stiffness, arm)
    # (φ × a) × f = (a fᵀ − (a·f) I) φ for every force f that acts at an arm a.
    arms = np.concatenate([arm, bary[..., None, :]], axis=-2)
    forces = np.concatenate([force, np.broadcast_to(weight, bary.shape)[..., None, :]], axis=-2)
    out[..., 3:, 3:] += np.sum(arms * forces, axis=(-1, -2))[..., None, None] * np.eye(3)
    out[..., 3:, 3:] -= np.swapaxes(arms, -1, -2) @ forces
    return out


def springs(stiffness: FloatArray, arm: FloatArray) -> FloatArray:
    """Stiffness (..., 6, 6), translation and rotation, of springs (..., n, 3, 3) at (..., n, 3)."""
    lever = rotations.hat(arm)
    coupling = (stiffness @ lever).sum(axis=-3)
    out = np.empty((*arm.shape[:-2], 6, 6))
    out[..., :3, :3] = stiffness.sum(axis=-3)
    out[..., :3, 3:], out[..., 3:, :3] = -coupling, -np.swapaxes(coupling, -1, -2)
    out[..., 3:, 3:] = -(lever @ stiffness @ lever).sum(axis=-3)
    return out


#: Step of the differences in time, s.
_STEP = 5.0e-3


def inertial(
    pose: Callable[[FloatArray], Pose], truth: Truth, inertia: FloatArray, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """D'Alembert's force and moment at times (N,), s, on a terminal that follows a course.

    Returns
    -------
    (N, 2, 3), N and N·m, about the LCS origin in the LCS; and its angular velocity (N, 3), rad/s,
    BCS.
    """
    h = _STEP
    back, here, ahead = (pose(time + shift) for shift in (-h, 0.0, h))
    R = here.rotation
    after = rotations.log(ahead.rotation @ np.swapaxes(R, 1, 2))
    before = rotations.log(R @ np.swapaxes(back.rotation, 1, 2))
    turning, turning_rate = (after + before) / (2 * h), (after - before) / h**2
    rise = (ahead.translation - 2 * here.translation + back.translation) / h**2
    bary = R @ truth.barycentre
    centre = rise + np.cross(turning_rate, bary)
    centre += np.cross(turning, np.cross(turning, bary))
    J = R @ (inertia - off_centre(truth)) @ np.swapaxes(R, 1, 2)
    spin = np.einsum("kab,kb->ka", J, turning)
    gyro = np.einsum("kab,kb->ka", J, turning_rate) + np.cross(turning, spin)
    push = -truth.mass * centre
    moment = -gyro + np.cross(bary, push)
    # Rows vᵀR are the components in the LCS.
    return np.asarray(np.stack([push, moment], axis=1) @ R), turning


@record
class Postures:
    """What is commanded: poses of the nominal terminal, and displacements that squeeze it.

    pose : (..., K). displacement : (..., K, n, 3), m, BCS, added to the hinges' places.
    """

    pose: Pose
    displacement: FloatArray

    def trial(self, index: int) -> Postures:
        """One trial of several."""
        pose = Pose(self.pose.rotation[index], self.pose.translation[index])
        return Postures(pose, self.displacement[index])

    def target(self, hinge: FloatArray) -> FloatArray:
        """Places for the carriages, (..., K, n, 3), m, BCS; hinge : (n, 3), nominal, LCS."""
        return self.pose.place(hinge) + self.displacement


@record
class Stage:
    """Campaigns before anything is recorded; leading axis of trials B.

    truth : (B,). postures : (B, K). servo : (B, K, n, 3), m, coordinates commanded to the servos.
    repeat : (B, K, n, 3), m, where the carriages really stand, less where they were sent.
    load : (B, K). force_offset : (B, K, n, 3), N, what no averaging removes from a reading.
    rest : (B, K), the terminal at rest.
    """

    truth: Truth
    postures: Postures
    servo: FloatArray
    repeat: FloatArray
    load: Load
    force_offset: FloatArray
    rest: Equilibrium


def internal_part(arm: FloatArray, force: FloatArray) -> FloatArray:
    """The part of hinge forces (..., n, 3) at arms (..., n, 3) that has no net wrench.

    Projection on the null space of the grasp matrix G = [I …; [a_1]× …], (6, 3n).
    """
    arm = arm - arm.mean(axis=-2, keepdims=True)
    grasp = np.concatenate(
        [
            np.broadcast_to(np.eye(3)[:, None, :], (*arm.shape[:-2], 3, arm.shape[-2], 3)),
            np.swapaxes(rotations.hat(arm), -3, -2),
        ],
        axis=-3,
    ).reshape(*arm.shape[:-2], 6, -1)
    flat = force.reshape(*force.shape[:-2], -1, 1)
    across = np.swapaxes(grasp, -1, -2)
    outer = across @ np.linalg.solve(grasp @ across, grasp @ flat)
    return np.asarray((flat - outer).reshape(force.shape), dtype=np.float64)


def draw_postures(rig: Rig, options: Options, rng: np.random.Generator, trials: int) -> Postures:
    """Random postures with their squeezes, (trials, K); or those of `options.command`.

    A squeeze is a vector of internal forces (see `Options.squeeze`) at the commanded pose, turned
    into displacements by the carriages' stiffness: with the terminal where the command has it,
    those displacements change the hinge forces by just that vector.
    """
    shape = (trials, options.count)
    uniform = rng.uniform
    lean = options.tilt * np.sqrt(uniform(size=shape))
    azimuth = uniform(-np.pi, np.pi, shape)
    axis = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(shape)], axis=-1)
    turn = uniform(-options.tilt, options.tilt, shape)[..., None] * np.array([0.0, 0.0, 1.0])
    pose = Pose(
        rotations.exp(turn) @ rotations.exp(lean[..., None] * axis),
        np.asarray(options.home) + uniform(-options.travel, options.travel, (*shape, 3)),
    )
    squeeze = options.squeeze * rng.standard_normal((*shape, rig.n, 3))
    if options.command is not None:
        return _commanded(rig, options.command, trials)
    force = internal_part(pose.place(rig.hinge), squeeze)
    give = np.linalg.inv(carriage_stiffness(rig, options))
    return Postures(pose, np.einsum("nij,...nj->...ni", give, force))


def _commanded(rig: Rig, command: FloatArray, trials: int) -> Postures:
    each = (np.repeat(part[None], trials, axis=0) for part in rotations.fit(rig.hinge, command))
    pose = Pose(*each)
    return Postures(pose, command - pose.place(rig.hinge))


def between(postures: Postures, moment: Moment) -> Postures:
    """Commands along the moves, (N,), from those of the postures, (K,).

    The terminal turns about a fixed axis from pose to pose, so that a move does not strain it.
    """
    R = postures.pose.rotation
    after = np.append(R[1:], R[-1:], axis=0)
    way = rotations.log(np.swapaxes(R, -1, -2) @ after)
    turn = rotations.exp(moment.share[:, None] * way[moment.index])
    pose = Pose(R[moment.index] @ turn, moment.blend(postures.pose.translation))
    return Postures(pose, moment.blend(postures.displacement))


def stand(
    truth: Truth, options: Options, target: FloatArray, repeat: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coordinates commanded to the servos, and where the carriages then stand.

    target, repeat, and both results : (..., K, n, 3), m, BCS. A carriage stands at its servo
    coordinates + datum + repeatability error. The machine was taught its coordinates with the
    terminal on, so that datum errors shift what it logs but do not strain the terminal.
    """
    datum = truth.datum[..., None, :, :]
    servo = target - datum
    home = (truth.hinge + np.asarray(options.home))[..., None, :, :]
    turned = faults.logged(options.faults, servo, home)
    return servo + turned, servo + datum + repeat


def set_stage(
    rig: Rig,
    options: Options,
    rng: np.random.Generator,
    trials: int,
    truth: Truth | None = None,
) -> Stage:
    """Draw rigs, unless they are known, and postures, and let the terminal settle; (trials, K)."""
    truth_rng, posture_rng, error_rng = rng.spawn(3)
    if truth is None:
        truth = draw_truths(rig, options, truth_rng, trials)
    postures = draw_postures(rig, options, posture_rng, trials)
    shape = (trials, options.count)
    declared = rig.declared
    repeat = declared.positioner * error_rng.standard_normal((*shape, rig.n, 3))
    force_offset = declared.force_noise * error_rng.standard_normal((*shape, rig.n, 3))
    friction = _hinge_friction(rig, options, postures.pose.rotation, error_rng)
    contact = np.array(
        np.broadcast_to(faults.contact(options.faults, options.count), (*shape, 2, 3)),
        dtype=np.float64,
    )
    servo, where = stand(truth, options, postures.target(rig.hinge), repeat)
    load = Load(contact, friction)
    rest = settle(truth, where, load, postures.pose)
    return Stage(truth, postures, servo, repeat, load, force_offset, rest)


def _hinge_friction(
    rig: Rig, options: Options, rotation: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Moment (B, K, 3), N·m, BCS, in postures (B, K, 3, 3): the declared one, and hysteresis
    against the turn by which each but the first is reached.
    """
    drawn = rig.declared.hinge_moment * rng.standard_normal((*rotation.shape[:2], 3))
    turn = rotations.log(rotation[:, 1:] @ np.swapaxes(rotation[:, :-1], -1, -2))
    size = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-12)
    drawn[:, 1:] -= rig.n * options.faults.hysteresis * (turn / size)
    return drawn


def reading(truth: Truth, force: FloatArray) -> FloatArray:
    """Noise-free readings f = (I + S) XᵀF + z of forces F (..., K, n, 3), N, BCS."""
    seen = np.einsum("...nji,...knj->...kni", truth.rotation, force)
    out = np.einsum("...nij,...knj->...kni", np.eye(3) + truth.sensitivity, seen)
    return np.asarray(out + truth.zero[..., None, :, :], dtype=np.float64)
