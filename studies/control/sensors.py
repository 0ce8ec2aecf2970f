"""TDFS in the loop: what they read, and what the controller makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.control.terminal import moment
from tdfscal.records import FloatArray
from tdfscal.simulation.truth import Truth


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

    @property
    def delay(self) -> float:
        """Time by which the filter is late on a slow force, s."""
        return (1.0 - self.gain) / self.gain / self.rate


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
