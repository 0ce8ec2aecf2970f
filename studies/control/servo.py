"""NCPs as servos: bandwidth, encoder resolution, and errors that depend on where they stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray

_WAVES = 8


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

    def __post_init__(self) -> None:
        if not self.bandwidth > 0.0:
            raise UsageError(f"a servo's bandwidth is {self.bandwidth:g} Hz", hint="give it in Hz")

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
