"""The spherical instrument: what its range and angle uncertainties make of a point (Eq. 25)."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.records import FloatArray, Instrument

ARCSEC = np.pi / 648_000
"""rad per second of arc."""


def range_covariance(xyz: FloatArray, instrument: Instrument) -> FloatArray:
    """Covariance (N, 3, 3), m², of points xyz (N, 3), m, in the tracker's frame, by its range."""
    r, along = _range(xyz)
    sigma = instrument.range + instrument.range_ppm * 1e-6 * r
    return np.asarray((sigma**2)[:, None, None] * along[:, :, None] * along[:, None, :])


def angle_covariance(xyz: FloatArray, instrument: Instrument) -> FloatArray:
    """Covariance (N, 3, 3), m², of points xyz (N, 3), m, in the tracker's frame, by its angles.

    Eq. 25: x = r sinφ cosθ, y = r sinφ sinθ, z = r cosφ, with σ_θ = σ_φ. An azimuth error moves
    the point by r sinφ σ_θ only; its second-order part, r cosφ σ_φ σ_θ, keeps the covariance
    regular at the zenith.
    """
    r, along = _range(xyz)
    sigma = instrument.angle_arcsec * ARCSEC
    sin, cos = np.hypot(along[:, 0], along[:, 1]), along[:, 2]
    theta = np.arctan2(along[:, 1], along[:, 0])
    zero = np.zeros_like(theta)
    u_theta = np.stack([-np.sin(theta), np.cos(theta), zero], axis=1)
    u_phi = np.stack([cos * np.cos(theta), cos * np.sin(theta), -sin], axis=1)
    by_theta = (r * sigma) ** 2 * (sin**2 + (cos * sigma) ** 2)
    by_phi = (r * sigma) ** 2
    return np.asarray(
        by_theta[:, None, None] * u_theta[:, :, None] * u_theta[:, None, :]
        + by_phi[:, None, None] * u_phi[:, :, None] * u_phi[:, None, :]
    )


def observe(
    xyz: FloatArray, instrument: Instrument, rng: np.random.Generator, trials: int
) -> FloatArray:
    """Draw `trials` observations (trials, N, 3), m, of points xyz (N, 3) through Eq. 25."""
    r, along = _range(xyz)
    draw = rng.standard_normal((3, trials, len(xyz)))
    sigma = instrument.angle_arcsec * ARCSEC
    r = r + (instrument.range + instrument.range_ppm * 1e-6 * r) * draw[0]
    theta = np.arctan2(along[:, 1], along[:, 0]) + sigma * draw[1]
    phi = np.arccos(np.clip(along[:, 2], -1, 1)) + sigma * draw[2]
    flat = r * np.sin(phi)
    return np.stack([flat * np.cos(theta), flat * np.sin(theta), r * np.cos(phi)], axis=-1)


def _range(xyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    r = np.linalg.norm(xyz, axis=1)
    if np.any(r == 0):
        raise DataError(Finding("points-at-instrument"))
    return r, xyz / r[:, None]
