"""`tdfscal validate`."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tdfscal.checks import faulty_sensors
from tdfscal.cli.app import command_line, emit
from tdfscal.cli.progress import reading_bar, stages
from tdfscal.dwells import find_dwells
from tdfscal.errors import UsageError
from tdfscal.files.output_places import check_calibration, check_place
from tdfscal.files.saving import write_text
from tdfscal.logs import iter_log
from tdfscal.records import InputFile, Log
from tdfscal.reporting.terminal import show
from tdfscal.reporting.validation import document, validation_report
from tdfscal.validation.residual_wrench import validate
from tdfscal.workflows.calibration_in_use import InUse, take


def run(
    calibration: Path,
    paths: list[Path],
    *,
    rig: Path | None,
    html: Path | None,
    json: bool,
    quiet: bool,
) -> int:
    """Test, print the verdict and return the exit status: 1 where the calibration fails."""
    check_calibration(calibration)
    if str(html) == "-":
        raise UsageError("--html - and the verdict both want standard output", hint="name a file")
    if html is not None:
        check_place(html, [calibration, *paths])
    use = take(calibration, paths, rig)
    for warning in use.warnings:
        print(f"tdfscal: WARNING: {warning}", file=sys.stderr)
    loaded = use.campaign.rig
    notes, inputs = list[str](), list[InputFile]()

    used = {entry.sha256 for entry in use.calibration.inputs}
    extremes: faulty_sensors.Extremes | None = None

    def heard(piece: Log) -> Log:
        nonlocal extremes
        extremes = faulty_sensors.extremes(piece, extremes)
        inputs.extend(piece.inputs)
        for entry in piece.inputs:
            if entry.sha256 in used:
                again = f"{entry.path} went into this calibration: what it shows is no proof"
                notes.append(again)
                print(f"tdfscal: WARNING: {again}", file=sys.stderr)
        return piece

    say = stages(quiet=quiet)
    say("reading the log and finding the dwells")
    logs = use.campaign.logs
    with reading_bar(logs, quiet=quiet) as bar:
        pieces = iter_log(logs, loaded.log, loaded.rig.supports, progress=bar)
        dwells = find_dwells(map(heard, pieces))
    say(f"testing the calibration on {len(dwells)} dwells")
    result = validate(use.given, dwells, rig=loaded.rig, noise=_fit_noise(use), extremes=extremes)
    # The log's own warnings come with its dwells.
    warnings = (*use.warnings, *notes, *result.warnings)
    if html is not None:
        from tdfscal.reporting.html import render_validation
        from tdfscal.reporting.validation import Origin

        say("drawing the report")
        created = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        origin = Origin(use.calibration, str(calibration), command_line(), created, tuple(inputs))
        write_text(html, render_validation(result, warnings, origin))
    if json:
        emit(document(result, warnings))
    else:
        show(validation_report(result, warnings))
    return 0 if result.holds else 1


def _fit_noise(use: InUse) -> float | None:
    """Noise per reading and axis that the calibration's own residuals show, N."""
    fit = use.calibration.fit
    # The residual force of a posture is the sum of n readings, three axes each.
    return None if fit is None else float(fit.rms_force / np.sqrt(3 * use.given.rig.n))
