"""Where the controller drives the NCPs, and where the terminal comes to rest on them."""

from __future__ import annotations

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import faults, rotations
from tdfscal.simulation.equilibrium import Equilibrium, Load, Pose, settle
from tdfscal.simulation.options import Options, carriage_stiffness
from tdfscal.simulation.truth import Truth, draw_truths


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
    faults.check(options.faults, rig.n, options.count)
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
