"""The positioners' errors as smooth functions of where they stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.records import FloatArray

#: Waves that make one component of a field.
_WAVES = 64


@dataclass(frozen=True, slots=True)
class ErrorField:
    """A stationary Gaussian field per support: squared-exponential correlation, by random waves.

    wave : (n, 3, W, 3), 1/m. phase : (n, 3, W). std : m per component.
    """

    wave: FloatArray
    phase: FloatArray
    std: float

    def __call__(self, servo: FloatArray) -> FloatArray:
        """Errors (N, n, 3), m, at servo coordinates (N, n, 3), m."""
        out = np.empty(servo.shape)
        for i, (wave, phase) in enumerate(zip(self.wave, self.phase, strict=True)):
            for a in range(3):
                angle = servo[:, i] @ wave[a].T + phase[a]
                out[:, i, a] = np.cos(angle).sum(axis=1)
        return np.asarray(self.std * np.sqrt(2.0 / _WAVES) * out)


def draw_field(n: int, std: float, correlation: float, rng: np.random.Generator) -> ErrorField:
    """Draw a field with correlation exp(−d²/2ℓ²) over the distance d, ℓ = correlation in m."""
    return ErrorField(
        rng.standard_normal((n, 3, _WAVES, 3)) / correlation,
        rng.uniform(-np.pi, np.pi, (n, 3, _WAVES)),
        std,
    )
