"""Static postures as the measurement model takes them, and how the zeros move over them.

The zero of a channel at posture k is z + Σ_g a_g φ_g(k): z holds at the first posture, and every
φ_g vanishes there, as a tare just before the campaign has it; zeros of an earlier campaign held at
its first posture, and φ_g counts from there (theory, section 11). The functions are a slope in
time, a slope in temperature, a parabola in time where a test asked for it, and the modes of a
random walk (Karhunen–Loève). The amplitudes a_g are parameters with a prior, per channel.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, sensing
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, Drift, Dwells, FloatArray, IntArray, Rig

Kind = Literal["time", "temperature", "parabola", "walk", "step"]

#: Modes of a random walk at most; what they leave counts as noise of each posture.
WALK_MODES = 40


@record
class ZeroMotion:
    """Functions by which zeros move, over K postures.

    kind : (G,). value : (K, n, G); time in s, temperature in K, a walk's modes in N.
    std : (G,), standard deviation of the amplitudes' prior: N/s, N/K, N/s², 1, N.
    remainder : N² per posture and channel, of a walk's modes that are left out.
    """

    kind: tuple[Kind, ...]
    value: FloatArray
    std: FloatArray
    remainder: float = 0.0

    def subset(self, keep: BoolArray | IntArray | slice) -> ZeroMotion:
        """Return the motion at the postures that keep selects."""
        return replace(self, value=self.value[keep])


@record
class ZeroAge:
    """How long before a log's first time its zeros held, and what has changed since.

    seconds : negative where the log begins before. warming : K, of the sensors' mean.
    known : by the clocks of both; else the least that is possible.
    """

    seconds: float = 0.0
    warming: float = 0.0
    known: bool = True


def zero_motion(
    drift: Drift,
    time: FloatArray,
    temperature: FloatArray | None,
    n: int,
    age: ZeroAge | None = None,
) -> ZeroMotion | None:
    """Build the functions for what a rig file declares; None where its zeros stay.

    time : (K,), s, of the postures. temperature : (K, n), °C, at each sensor. age : of the zeros
    at the first posture; default none, they hold there.
    """
    age = age or ZeroAge()
    elapsed = np.repeat((time - time[0] + age.seconds)[:, None], n, axis=1)
    parts: list[tuple[Kind, FloatArray, float]] = []
    if drift.time > 0:
        parts.append(("time", elapsed, drift.time))
    if drift.temperature > 0 and temperature is not None:
        warming = temperature - temperature[0] + age.warming
        parts.append(("temperature", warming, drift.temperature))
    if drift.parabola > 0:
        parts.append(("parabola", elapsed**2, drift.parabola))
    remainder = 0.0
    if drift.walk > 0:
        modes, remainder = walk_modes(drift.walk, time)
        before = np.full((len(time), 1), drift.walk * np.sqrt(abs(age.seconds)))
        modes = np.hstack([before, modes]) if age.seconds else modes
        parts += [("walk", np.repeat(mode[:, None], n, axis=1), 1.0) for mode in modes.T]
    if not parts:
        return None
    kinds, values, std = zip(*parts, strict=True)
    return ZeroMotion(kinds, np.stack(values, axis=2), np.array(std), remainder)


def walk_modes(intensity: float, time: FloatArray) -> tuple[FloatArray, float]:
    """Modes (K, m), N, of a random walk from time[0] on, and the variance that they leave, N².

    intensity : N/√s. The covariance of a walk is q² min(t_k, t_l). A few postures get all of its
    eigenvectors; many get the sines of the continuous walk, and their remainder, which changes
    over K/m postures together, counts as K/m times its variance in every one of them.
    """
    elapsed, K = time - time.min(), len(time)
    span = float(elapsed.max(initial=0.0))
    if not span > 0:
        return np.zeros((K, 0)), 0.0
    if K <= WALK_MODES + 1:
        values, vectors = np.linalg.eigh(np.minimum(elapsed[:, None], elapsed[None]))
        kept = values > values[-1] * K * np.finfo(float).eps
        return intensity * vectors[:, kept] * np.sqrt(values[kept]), 0.0
    rate = (np.arange(WALK_MODES) + 0.5) * np.pi / span
    modes = np.sin(elapsed[:, None] * rate) * np.sqrt(2.0 / span) / rate
    left = span / 2.0 - 0.5 * float(np.sum(2.0 / span / rate**2))
    return intensity * modes, intensity**2 * left * K / WALK_MODES


@record
class Postures:
    """Static postures as the balance sees them.

    position, force : (K, n, 3), servo in the BCS (m), reading in the sensor frame (N).
    position_cov, force_cov : (K, n, 3, 3), all that does not average out included.
    moment_var : N²m², variance per axis of an additive moment (friction of the hinges).
    friction_sense : (K, 3), unit vector of the turn by which a posture was reached, BCS; 0 unknown.
    measured : (n, 3), which components the sensors measure; the readings of others are ignored.
    motion : how the zeros may move over the postures. noise_from_residuals : nobody states the
    noise of the forces; it is what a fit leaves.
    """

    position: FloatArray
    force: FloatArray
    position_cov: FloatArray
    force_cov: FloatArray
    moment_var: float
    friction_sense: FloatArray
    measured: BoolArray
    motion: ZeroMotion | None = None
    noise_from_residuals: bool = False

    def __len__(self) -> int:
        return len(self.force)

    @property
    def motions(self) -> int:
        """Number of functions by which zeros may move, G."""
        return 0 if self.motion is None else len(self.motion.std)

    def subset(self, keep: BoolArray | IntArray | slice) -> Postures:
        """Return the postures that keep (a mask, indices or a slice) selects."""
        arrays = ("position", "force", "position_cov", "force_cov", "friction_sense")
        motion = None if self.motion is None else self.motion.subset(keep)
        return replace(self, motion=motion, **{name: getattr(self, name)[keep] for name in arrays})


@record
class Rests:
    """Of K postures at rest the number (K,) by which each goes, and when it was held, s (K,)."""

    number: IntArray
    time: FloatArray


def alike(
    position: FloatArray,
    force: FloatArray,
    measured: BoolArray,
    *,
    place: float = 1.0,
    noise: float = 1.0,
    moment_var: float = 0.0,
    motion: ZeroMotion | None = None,
) -> Postures:
    """Postures whose axes all scatter alike, reached from nowhere.

    position, force : (K, n, 3). place : m, noise : N, standard deviations of a component.
    """
    unit = np.broadcast_to(np.eye(3), (*force.shape, 3))
    return Postures(
        position=position,
        force=force,
        position_cov=place**2 * unit,
        force_cov=noise**2 * unit,
        moment_var=moment_var,
        friction_sense=np.zeros((len(force), 3)),
        measured=measured,
        motion=motion,
    )


def postures(rig: Rig, dwells: Dwells, age: ZeroAge | None = None) -> Postures:
    """Dwells with the rig's declared uncertainties added to those of their means.

    age : of the zeros at the first dwell; default none, they hold there.
    """
    eye = np.eye(3)
    time = (dwells.start + dwells.end) / 2
    motion = zero_motion(rig.drift, time, dwells.temperature, rig.n, age)
    excess = rig.declared.force_noise**2 + (0.0 if motion is None else motion.remainder)
    both = rig.axes[:, :, None] & rig.axes[:, None, :]
    return Postures(
        position=dwells.position,
        force=np.where(rig.axes, dwells.force, 0.0),
        position_cov=dwells.position_cov + rig.declared.positioner**2 * eye,
        force_cov=np.where(both, dwells.force_cov + excess * eye, 0.0),
        moment_var=rig.declared.hinge_moment**2,
        friction_sense=friction_senses(register(rig.hinge, dwells.position)[0]),
        measured=rig.axes,
        motion=motion,
    )


def forces(state: State, reading: FloatArray) -> FloatArray:
    """F_i = X_i (I + S_i)⁻¹ (f_i − z_i) in the BCS, N; reading (..., K, n, 3)."""
    load = reading - state.zero[..., None, :, :]
    return np.asarray(np.einsum("...nab,...knb->...kna", sensing(state), load))


def zeros(state: State, posture: Postures) -> FloatArray:
    """Zero of every channel at every posture, N: (K or 1, n, 3)."""
    if posture.motion is None or not state.motions:
        return state.zero[None]
    return np.asarray(state.zero + np.einsum("kng,gna->kna", posture.motion.value, state.drift))


#: A turn from posture to posture below this leaves the hinges as they were, rad.
_TURNED = 1e-4
#: Rounds of registering postures on their mean.
_ROUNDS = 10


def register(hinge: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pose of the terminal: R (K, 3, 3) and T (K, 3) with R r_i + T ≈ p_i (Eq. 1).

    hinge (n, 3) in the LCS, position (K, n, 3) in the BCS, m; least squares over all n hinges.
    """
    r0, p0 = hinge.mean(axis=0), position.mean(axis=-2)
    R = so3.project(np.einsum("kni,nj->kij", position - p0[:, None], hinge - r0))
    return R, p0 - R @ r0


def mean_shape(position: FloatArray) -> tuple[FloatArray, int, float]:
    """Mean shape (n, 3) of positions (K, n, 3), its posture of reference, and its misfit, m.

    Generalised Procrustes: postures are registered on their mean, in turn. The shape is parallel to
    the posture nearest to the mean, its origin in the hinges' centre.
    """
    centred = position - position.mean(axis=1, keepdims=True)
    reference = int(np.argmin(((centred - centred.mean(axis=0)) ** 2).sum(axis=(1, 2))))
    shape = centred[reference]
    for _ in range(_ROUNDS):
        aligned = centred @ register(shape, centred)[0]
        shape = aligned.mean(axis=0)
    spread = float(np.sqrt(((aligned - shape) ** 2).sum(axis=2).mean()))
    turn, _ = register(shape, centred[None, reference])
    return shape @ turn[0].T, reference, spread


def friction_senses(rotation: FloatArray) -> FloatArray:
    """Unit vectors (K, 3), BCS, of the turns from posture to posture; rotation (K, 3, 3).

    Where a posture differs from the one before by a squeeze or a shift only, its hinges stay as
    they were turned last. How the first posture was reached nobody knows: 0.
    """
    out = np.zeros((len(rotation), 3))
    turn = so3.log(rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2))
    size = np.linalg.norm(turn, axis=1)
    moved = np.flatnonzero(size > _TURNED)
    if len(moved):
        last = np.searchsorted(moved, np.arange(len(turn)), side="right") - 1
        unit = turn[moved] / size[moved, None]
        out[1:] = np.where(last[:, None] >= 0, unit[np.maximum(last, 0)], 0.0)
    return out
