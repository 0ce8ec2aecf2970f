"""A calibration file as parameters of the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import calibrated_from
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.records import FloatArray, UncertainValue


def calibrated(calibration: Calibration) -> Calibrated:
    """Return the parameters of a calibration file with their covariance."""
    rig = calibration.rig.record()
    if calibration.parameters is not None:
        return calibrated_from(calibration.parameters, rig, calibration.rotation)
    mass, barycentre = calibration.terminal.mass, calibration.terminal.barycenter
    error = calibration.sensitivity - np.eye(3)
    return independent(
        rig,
        calibration.rotation,
        calibration.rotation_covariance,
        zero=UncertainValue(calibration.zero, calibration.zero_std),
        mass=UncertainValue(np.array(mass.value), _std([mass.std])[0]),
        barycentre=UncertainValue(np.array(barycentre.value), _std(barycentre.std)),
        sensitivity=error[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
    )


def _std(values: Sequence[float | None]) -> FloatArray:
    """Standard uncertainties of the file, ∞ where it has none."""
    return np.array([np.inf if value is None else value for value in values])
