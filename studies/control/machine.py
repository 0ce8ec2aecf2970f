"""The parts of the controlled machine: impedance, force sensors, positioners.

Impedance (Sect. 5): M ẍ + B ẋ + K (x − x_d) = F_e − F_d in six dimensions, x the pose of the centre
of compliance, a point of the terminal: three translations and three rotations, in the axes of the
reference LCS. Held forces are integrated exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from studies.control.terminal import moment
from tdfscal.records import FloatArray
from tdfscal.simulation.truth import Truth

_WAVES = 8


@dataclass(frozen=True, slots=True)
class Impedance:
    """Virtual mass, damping and stiffness: translations along x, y, z, rotations about x, y, z.

    mass : kg, kg·m². damping : N·s/m, N·m·s/rad. stiffness : N/m, N·m/rad. centre : (3,), m,
    LCS, the centre of compliance. relative : B (ẋ − ẋ_d) instead of B ẋ. The defaults are
    `stability.designed` of the reference rig.
    """

    mass: tuple[float, ...] = (500.0, 500.0, 500.0, 72.0, 72.0, 72.0)
    damping: tuple[float, ...] = (3.3e4, 3.3e4, 3.3e4, 9.9e3, 9.9e3, 9.9e3)
    stiffness: tuple[float, ...] = (1.0e4, 1.0e4, 1.0e4, 3.0e3, 3.0e3, 3.0e3)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.5)
    relative: bool = False


def transition(impedance: Impedance, step: float) -> tuple[FloatArray, FloatArray]:
    """State (6, 2, 2) and drive (6, 2) of an exact step (s) of M d̈ + B ḋ + K d = g, g held.

    Per axis (d, ḋ) ← state (d, ḋ) + drive · g, of the deviation d = x − x_d and its rate.
    """
    M, B, K = (np.array(v) for v in (impedance.mass, impedance.damping, impedance.stiffness))
    A = np.zeros((6, 3, 3))
    A[:, 0, 1] = step
    A[:, 1, 0], A[:, 1, 1], A[:, 1, 2] = -K / M * step, -B / M * step, step / M
    whole = expm(A)
    return whole[:, :2, :2], whole[:, :2, 2]


@dataclass(frozen=True, slots=True)
class Sensing:
    """Sampling of the force sensors.

    rate : Hz. noise : N, standard deviation of one sample per axis. gain : per sample, of a
    low-pass of first order (a Kalman filter for a random walk in its steady state); 1 for none.
    watch : s, time constant with which the wrench is smoothed for thresholds and records, outside
    the loop.
    """

    rate: float = 250.0
    noise: float = 1.75
    gain: float = 0.2
    watch: float = 0.1


class Sensors:
    """The real sensors: f = (I + S) XᵀF + z, noise apart."""

    def __init__(self, truth: Truth) -> None:
        self._gain = (np.eye(3) + truth.sensitivity) @ np.swapaxes(truth.rotation, -1, -2)
        self._zero = truth.zero

    def read(self, force: FloatArray) -> FloatArray:
        """Readings (L, n, 3), N, sensor frames, of forces on the terminal (L, n, 3), N, BCS."""
        return np.asarray((self._gain @ force[..., None])[..., 0] + self._zero)


class WrenchObserver:
    """The controller's contact wrench: F = X (I + S)⁻¹ (f − z), weight taken off (Eq. 9)."""

    def __init__(self, assumed: Truth, centre: FloatArray) -> None:
        """Assumed : what the controller takes for true. centre : (3,), m, LCS, of the moments."""
        self._map = assumed.rotation @ np.linalg.inv(np.eye(3) + assumed.sensitivity)
        self._zero = assumed.zero
        self._weight = (assumed.mass[:, None] * assumed.gravity)[:, None, :]
        self._lever = (
            np.concatenate([assumed.hinge, assumed.barycentre[:, None, :]], axis=1) - centre
        )

    def wrench(self, reading: FloatArray, R: FloatArray) -> FloatArray:
        """Contact wrench (L, 6): N and N·m about the centre, LCS; R (L, 3, 3) as commanded."""
        force = (self._map @ (reading - self._zero)[..., None])[..., 0]
        seen = np.concatenate([force, self._weight], axis=1) @ R  # rows: Rᵀ F
        out = np.empty((len(R), 6))
        out[:, :3] = -seen.sum(axis=1)
        out[:, 3:] = -moment(self._lever, seen)
        return out


@dataclass(frozen=True, slots=True)
class Servo:
    """A servo axis of an NCP.

    bandwidth : Hz, −3 dB of the closed position loop, taken as of first order; ∞ for none.
    resolution : m, of the encoder; 0 for none. waves : m, shortest and longest wavelength of the
    positioning error along a travel.
    """

    bandwidth: float = 15.0
    resolution: float = 1.0e-7
    waves: tuple[float, float] = (0.01, 0.1)

    @property
    def lag(self) -> float:
        """Time constant, s."""
        return 1.0 / (2.0 * np.pi * self.bandwidth)

    def share(self, step: float) -> float:
        """Of the way to its command that a servo covers in a step (s)."""
        return float(-np.expm1(-step / self.lag)) if np.isfinite(self.bandwidth) else 1.0

    def command(self, target: FloatArray) -> FloatArray:
        """Targets, m, as the encoder resolves them."""
        if self.resolution == 0.0:
            return target
        return np.asarray(np.rint(target / self.resolution) * self.resolution)


@dataclass(frozen=True, slots=True)
class PositionErrors:
    """Smooth random field of positioning errors, one per carriage: Σ a cos(k·q + φ).

    wave : (L, n, 3, W), rad/m. phase : (L, n, 1, W). amplitude : (L, n, W, 3), m.
    """

    wave: FloatArray
    phase: FloatArray
    amplitude: FloatArray

    def at(self, place: FloatArray) -> FloatArray:
        """Errors (L, n, 3), m, at carriage coordinates (L, n, 3), m."""
        angle = place[..., None, :] @ self.wave + self.phase
        return np.asarray((np.cos(angle) @ self.amplitude)[..., 0, :])


def draw_errors(
    servo: Servo, sd: float, runs: int, n: int, rng: np.random.Generator
) -> PositionErrors:
    """Fields of standard deviation sd (m) per axis; independent by run, carriage and axis.

    A carriage that comes back to a place in the same run finds the same error there: what the
    repeatability adds from run to run is a new field.
    """
    shape = (runs, n, _WAVES)
    way = rng.standard_normal((*shape, 3))
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    low, high = np.log(servo.waves)
    wave = 2.0 * np.pi * np.exp(-rng.uniform(low, high, shape))
    return PositionErrors(
        wave=np.swapaxes(way * wave[..., None], -1, -2),
        phase=rng.uniform(-np.pi, np.pi, shape)[:, :, None, :],
        # Normal amplitudes of variance 2/W: variance sd² per axis, independent axes.
        amplitude=sd * np.sqrt(2.0 / _WAVES) * rng.standard_normal((*shape, 3)),
    )
