"""From a calibration file, and the rig of a log, to a calibration in use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tdfscal.checks.same_rig import contradictions
from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.parameters import calibrated_from
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.records import FloatArray, UncertainValue
from tdfscal.workflows.calibration import Calibration, CalibrationSource, read_source, unsealed
from tdfscal.workflows.campaign import Campaign, resolve


@dataclass(frozen=True, slots=True)
class InUse:
    """A calibration with the logs that it is used on.

    name : of its file, for messages. given : with the inertia and the declared uncertainties of
    the logs' rig. warnings : what a user must know first.
    """

    name: str
    calibration: Calibration
    given: Calibrated
    campaign: Campaign
    warnings: tuple[str, ...]


def calibrated(calibration: CalibrationFile, source: Path | str = "calibration") -> Calibrated:
    """Return the parameters of a calibration file with their covariance; source is for messages."""
    rig = calibration.loaded_rig(source).rig
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


def take(calibration: CalibrationSource, paths: Sequence[Path], rig: Path | None = None) -> InUse:
    """Load a calibration and find the logs to use it on, with their rig.

    The rig is that of the campaign folder, or `rig`, else the one that the calibration embeds.

    Raises UsageError where that rig contradicts the calibrated one, or there is no log; else as
    `load_calibration` and `resolve`.
    """
    name, loaded = read_source(calibration)
    campaign = resolve(paths, rig, fallback=loaded.loaded_rig(name))
    if not campaign.logs:
        raise UsageError(
            "there is no log here",
            where=", ".join(map(str, paths)),
            hint="name a folder with .csv, .parquet or .mcap logs, or the logs themselves",
        )
    given = calibrated(loaded, name)
    other = campaign.rig.rig
    found = contradictions(given.rig, other)
    if found:
        raise UsageError(
            f"the rig of the log is not the one that was calibrated: {'; '.join(found)}",
            where=str(campaign.rig.path),
            hint="correct the rig file, or calibrate this rig",
        )
    used = replace(given.rig, inertia=other.inertia, declared=other.declared)
    return InUse(name, loaded, replace(given, rig=used), campaign, _warnings(loaded, name))


def _warnings(calibration: Calibration, path: str) -> tuple[str, ...]:
    told = unsealed(calibration, path)
    if calibration.status == "accepted":
        return told
    return (
        f"{path} IS A REJECTED CALIBRATION, not fit for use: "
        f"{'; '.join(calibration.quality.reasons)}",
        *told,
    )
