"""`tdfscal validate`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from tdfscal.cli.app import emit
from tdfscal.dwells import find_dwells
from tdfscal.files.inuse import InUse, take
from tdfscal.files.logs import iter_log
from tdfscal.records import Log
from tdfscal.reporting.verdict import document, render
from tdfscal.validation import validate


def run(calibration: Path, paths: list[Path], *, rig: Path | None, json: bool) -> int:
    """Test, print the verdict and return the exit status: 1 where the calibration fails."""
    use = take(calibration, paths, rig)
    for warning in use.warnings:
        print(f"tdfscal: WARNING: {warning}", file=sys.stderr)
    loaded = use.campaign.rig
    notes: list[str] = []

    used = {entry.sha256 for entry in use.calibration.inputs}

    def heard(piece: Log) -> Log:
        notes.extend(piece.warnings)
        for entry in piece.inputs:
            if entry.sha256 in used:
                again = f"{entry.path} went into this calibration: what it shows is no proof"
                notes.append(again)
                print(f"tdfscal: WARNING: {again}", file=sys.stderr)
        return piece

    pieces = map(heard, iter_log(use.campaign.logs, loaded.log, loaded.rig.supports))
    result = validate(use.given, find_dwells(pieces), rig=loaded.rig, noise=_fit_noise(use))
    warnings = (*use.warnings, *notes, *result.warnings)
    if json:
        emit(document(result, warnings))
    else:
        print(render(result, warnings))
    return 0 if result.holds else 1


def _fit_noise(use: InUse) -> float | None:
    """Noise per reading and axis that the calibration's own residuals show, N."""
    fit = use.calibration.fit
    # The residual force of a posture is the sum of n readings, three axes each.
    return None if fit is None else float(fit.rms_force / np.sqrt(3 * use.given.rig.n))
