"""All parameters of a self-calibration with their joint posterior covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.model.calibrated import Calibrated, with_rotations
from tdfscal.model.parameters import parameter_count, retract, with_motions
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import factored_information
from tdfscal.selfcal.estimator import Fit


def from_fit(
    fit: Fit, rotation_covariance: FloatArray, rotation: FloatArray | None = None
) -> Calibrated:
    """All parameters of a self-calibration with their joint posterior covariance.

    rotation_covariance : (3n, 3n), rad², as published; it may differ from the fit's own (Birge
    ratio, noise that fakes information, a tracker's share). rotation : (n, 3, 3), as published,
    where it is not the fit's. The other parameters keep their distribution given the rotations.
    Combinations that no posture sees (theory, section 4) carry no variance: they do not show in
    any contact wrench at rest either.
    """
    size, turns = len(fit.active), 3 * fit.rig.n
    parts = factored_information(fit)
    free = np.flatnonzero(fit.active)
    posterior = np.zeros((size, size))
    posterior[np.ix_(free, free)] = parts.root @ parts.root.T
    # How zeros moved belongs to this campaign alone.
    size = parameter_count(fit.rig.n)
    posterior, state = posterior[:size, :size], with_motions(fit.state, 0)
    if rotation is not None:
        turn = so3.log(rotation @ np.swapaxes(state.rotation, 1, 2)).ravel()
        along = np.linalg.solve(posterior[:turns, :turns], turn)
        state = replace(retract(state, posterior[:, :turns] @ along), rotation=rotation)
    return Calibrated(
        rig=fit.rig,
        state=state,
        covariance=with_rotations(posterior, turns, rotation_covariance),
        open=np.zeros(size, dtype=np.bool_),
        joint=True,
    )
