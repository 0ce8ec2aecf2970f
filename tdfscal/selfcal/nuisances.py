"""Estimates of zeros that move and of supports that give, and what they cost the angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.parameters import layout
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray, IntArray
from tdfscal.selfcal.covariance import Uncertainty
from tdfscal.selfcal.estimator import Fit


@dataclass(frozen=True, slots=True)
class Estimate:
    """A group of parameters beside the angles.

    kind : time, temperature, parabola, walk; lateral, vertical. value, std : (n, 3) per channel in
    N/s, N/K, N/s², or () in m/N; of a walk None. share : (n, 3), part of the variance of roll,
    pitch, yaw that would be gone if the group were known.
    """

    kind: str
    value: FloatArray | None
    std: FloatArray | None
    share: FloatArray


def drift_estimates(fit: Fit, parts: Spectrum, found: Uncertainty) -> tuple[Estimate, ...]:
    """Estimate of each kind of drift that the rig file declares."""
    motion, n = fit.postures.motion, fit.rig.n
    if motion is None:
        return ()
    place = layout(n, fit.state.motions)["drift"]
    std = found.parameter_std[place].reshape(-1, n, 3)
    estimates = []
    for kind in dict.fromkeys(motion.kind):
        which = np.flatnonzero([other == kind for other in motion.kind])
        rows = (place.start + 3 * n * which[:, None] + np.arange(3 * n)).ravel()
        alone = kind != "walk"  # a walk's modes say nothing one by one
        estimates.append(
            Estimate(
                kind,
                fit.state.drift[which[0]] if alone else None,
                std[which[0]] if alone else None,
                _share(fit, parts, rows),
            )
        )
    return tuple(estimates)


def compliance_estimates(fit: Fit, parts: Spectrum, found: Uncertainty) -> tuple[Estimate, ...]:
    """Estimate of each compliance that the rig file declares."""
    place = layout(fit.rig.n)["compliance"]
    return tuple(
        Estimate(
            kind,
            fit.state.compliance[j],
            found.parameter_std[place][j],
            _share(fit, parts, np.array([place.start + j])),
        )
        for j, kind in enumerate(("lateral", "vertical"))
        if fit.active[place.start + j]
    )


def _share(fit: Fit, parts: Spectrum, rows: IntArray) -> FloatArray:
    """C_ad C_dd⁺ C_da over C_aa, for roll, pitch, yaw (n, 3); rows : places of the parameters d."""
    columns = np.flatnonzero(fit.active)
    turns, own = parts.root[columns < 3 * fit.rig.n], parts.root[np.isin(columns, rows)]
    cross = turns @ own.T
    gone = cross @ np.linalg.pinv(own @ own.T, hermitian=True) @ cross.T
    R = fit.state.rotation
    whole = so3.rpy_variance(R, turns @ turns.T)
    return np.asarray(so3.rpy_variance(R, gone) / np.maximum(whole, np.finfo(float).tiny))
