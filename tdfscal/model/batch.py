"""The balance for many perturbed campaigns at once: residual and its adjoint, T trials together.

The same equations as `statics`, with poses and lever arms of one linearisation; readings, errors
of the poses and states vary over the trials. The trial axis comes last, so that every product
runs over contiguous memory and the products over postures are matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.parameters import SYMMETRIC, State, gravity, layout, unmixing, vector
from tdfscal.model.statics import Balance
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Perturbed:
    """T perturbed campaigns.

    reading : (K, n, 3, T), N, sensor frames. wrench : (K, 6, T), N and N·m, added to the balance.
    """

    reading: FloatArray
    wrench: FloatArray


@dataclass(frozen=True, slots=True)
class Trials:
    """States of T trials, trial axis last: turn (n, 3, 3, T) and the other parameters (P, T)."""

    turn: FloatArray
    vector: FloatArray

    @classmethod
    def at(cls, state: State, trials: int) -> Trials:
        """T copies of one state."""
        return cls(
            np.repeat(state.rotation[..., None], trials, axis=-1),
            np.repeat(vector(state)[:, None], trials, axis=-1),
        )

    def moved(self, step: FloatArray) -> Trials:
        """Retract by step (P, T); the rotations' own entries of the vector stay unused."""
        n = len(self.turn)
        delta = np.moveaxis(step[: 3 * n].reshape(n, 3, -1), 1, 2)  # (n, T, 3)
        turn = so3.exp(delta) @ np.moveaxis(self.turn, -1, 1)
        return Trials(np.ascontiguousarray(np.moveaxis(turn, 1, -1)), self.vector + step)

    @property
    def rotation(self) -> FloatArray:
        """X (T, n, 3, 3)."""
        return np.moveaxis(self.turn, -1, 0)


class Equations:
    """Residual and adjoint of the used postures (a mask (K,)) about one linearisation.

    free : (P,), which parameters vary; the groups that do not are not computed.
    """

    def __init__(
        self, at: Balance, used: BoolArray, state: State, free: BoolArray, g: float
    ) -> None:
        n = state.n
        self.n, self.g, self.at, self.place = n, g, at, layout(n, state.motions)
        self.free = {group: bool(free[place].any()) for group, place in self.place.items()}
        K = int(used.sum())
        self.force = np.ascontiguousarray(np.moveaxis(at.wrench[used], 1, 2).reshape(K, 6, 3 * n))
        # Columns of γ, (r_m − c) ⊗ γ, then hinge, datum, compliance, friction.
        self.tail = [g for g in ("hinge", "datum", "compliance", "friction") if self.free[g]]
        fixed = at.design[used, :, 12 * n : 18 * n + 15]
        if not self.tail:
            fixed = fixed[:, :, :12]
        motion = at.seen.motion if self.free["drift"] else None
        self.motion = None if motion is None else np.ascontiguousarray(motion.value[used])
        self.fixed = np.ascontiguousarray(fixed.reshape(6 * K, -1))
        self.gravity = gravity(state, g)[:, None]
        self.inverse = unmixing(state.sensitivity)[..., None]

    def residual(self, trials: Trials, data: Perturbed) -> FloatArray:
        """Force (N) and moment (N·m, about c) of every posture and trial, (K, 6, T), BCS."""
        F = self._forces(trials, data)
        K, T = F.shape[0], F.shape[-1]
        e = self.force @ F.reshape(K, 3 * self.n, T)
        e += (self.fixed @ self._fixed_features(trials)).reshape(K, 6, T)
        e += data.wrench
        return np.asarray(e)

    def pull_back(self, trials: Trials, data: Perturbed, v: FloatArray) -> FloatArray:
        """Σ_k J_kᵀ v_k (P, T), J the Jacobian at each trial's own state; v (K, 6, T)."""
        n, place, K, T = self.n, self.place, v.shape[0], v.shape[-1]
        out = np.zeros((place["drift"].stop, T))
        load = data.reading - self._zeros(trials)
        u = (np.swapaxes(self.force, 1, 2) @ v).reshape(K, n, 3, T)
        moment = np.stack(  # Σ_k (f − z) uᵀ, (n, 3, 3, T)
            [np.sum(load[:, :, a, None] * u, axis=0) for a in range(3)], axis=1
        )
        M = self._sensing(trials)
        # A turn δ changes F by δ × F, so its adjoint is Σ F × u.
        FU = _multiply(M, moment)
        out[place["rotation"]] = np.stack(
            [FU[:, 1, 2] - FU[:, 2, 1], FU[:, 2, 0] - FU[:, 0, 2], FU[:, 0, 1] - FU[:, 1, 0]],
            axis=1,
        ).reshape(3 * n, T)
        if self.free["zero"]:
            out[place["zero"]] = -np.sum(M * u.sum(axis=0)[:, :, None], axis=1).reshape(3 * n, T)
        if self.motion is not None:
            moved = np.einsum("kng,knat->gnat", self.motion, u, optimize=True)
            back = -np.einsum("nabt,gnat->gnbt", M, moved)
            out[place["drift"]] = back.reshape(-1, T)
        if self.free["sensitivity"]:
            # dF = −M E w with w = (I + S)⁻¹ (f − z): Σ_k (Mᵀ u) wᵀ against each E.
            Q = _multiply(np.swapaxes(M, 1, 2), _transpose(_multiply(self._unmix(trials), moment)))
            out[place["sensitivity"]] = -np.einsum("jab,nabt->njt", SYMMETRIC, Q).reshape(6 * n, T)
        self._pull_fixed(trials, self.fixed.T @ v.reshape(6 * K, T), out)
        return out

    def _zeros(self, trials: Trials) -> FloatArray:
        """Zeros (n, 3, T), or (K, n, 3, T) where they move."""
        zero = self._part(trials, "zero").reshape(self.n, 3, -1)
        if self.motion is None:
            return zero
        amplitude = self._part(trials, "drift").reshape(-1, self.n, 3, zero.shape[-1])
        moved = np.einsum("kng,gnat->knat", self.motion, amplitude, optimize=True)
        return np.asarray(zero + moved)

    def _part(self, trials: Trials, group: str) -> FloatArray:
        return trials.vector[self.place[group]]

    def _unmix(self, trials: Trials) -> FloatArray:
        """(I + S)⁻¹, (n, 3, 3, 1 or T)."""
        if not self.free["sensitivity"]:
            return self.inverse
        voigt = np.moveaxis(self._part(trials, "sensitivity").reshape(self.n, 6, -1), 1, 2)
        return np.moveaxis(unmixing(voigt), 1, -1)

    def _sensing(self, trials: Trials) -> FloatArray:
        return _multiply(trials.turn, self._unmix(trials))

    def _forces(self, trials: Trials, data: Perturbed) -> FloatArray:
        """F (K, n, 3, T)."""
        M = self._sensing(trials)
        load = data.reading - self._zeros(trials)
        F = M[:, :, 0] * load[:, :, 0, None]
        F += M[:, :, 1] * load[:, :, 1, None]
        F += M[:, :, 2] * load[:, :, 2, None]
        return np.asarray(F)

    def _gravity(self, trials: Trials) -> FloatArray:
        """Gravity (3, T), or (3, 1) where its direction does not vary."""
        if not self.free["tilt"]:
            return self.gravity
        turn = np.zeros((trials.vector.shape[1], 3))
        turn[:, :2] = self._part(trials, "tilt").T
        down: FloatArray = -so3.exp(turn)[:, :, 2].T
        return self.g * down

    def _fixed_features(self, trials: Trials) -> FloatArray:
        """Features after those of the forces, (12 or 15 + 6n, T)."""
        weight = self._part(trials, "mass") * self._gravity(trials)
        lever = self._part(trials, "barycentre") - self.at.centre[:, None]
        parts = [weight, (lever[:, None] * weight).reshape(9, -1)]
        if self.fixed.shape[1] > 12:
            parts += [
                self._part(trials, "hinge") - self.at.hinge.reshape(-1, 1),
                self._part(trials, "datum") - self.at.datum.reshape(-1, 1),
                self._part(trials, "compliance") - self.at.compliance[:, None],
                self._part(trials, "friction"),
            ]
        return np.concatenate(parts)

    def _pull_fixed(self, trials: Trials, pull: FloatArray, out: FloatArray) -> None:
        """Chain rule of `_fixed_features`."""
        gvec, mass = self._gravity(trials), self._part(trials, "mass")
        lever = self._part(trials, "barycentre") - self.at.centre[:, None]
        cross = pull[3:12].reshape(3, 3, -1)
        of_weight = pull[:3] + np.sum(lever[:, None] * cross, axis=0)
        out[self.place["mass"]] = np.sum(of_weight * gvec, axis=0)
        out[self.place["barycentre"]] = np.sum(cross * (mass * gvec), axis=1)
        if self.free["tilt"]:
            # d(weight) = (J dt) × weight; J is the identity to the second order of the tilt.
            out[self.place["tilt"]] = np.cross(mass * gvec, of_weight, axis=0)[:2]
        if self.fixed.shape[1] > 12:
            first, last = self.place["hinge"], self.place["datum"]
            out[first.start : last.stop] = pull[12 : 12 + 6 * self.n]
            out[self.place["compliance"].start : self.place["friction"].stop] = pull[-3:]


def _multiply(A: FloatArray, B: FloatArray) -> FloatArray:
    """Product of (n, 3, 3, T) and (n, 3, 3, T or 1), trial by trial."""
    C = A[:, :, 0, None] * B[:, None, 0]
    C += A[:, :, 1, None] * B[:, None, 1]
    C += A[:, :, 2, None] * B[:, None, 2]
    return np.asarray(C)


def _transpose(A: FloatArray) -> FloatArray:
    return np.swapaxes(A, 1, 2)
