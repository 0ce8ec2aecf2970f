"""`tdfscal study sensitivity` and `tdfscal study accuracy`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tdfscal.cli.app import emit
from tdfscal.cli.progress import speaker
from tdfscal.cli.rigs import calibrations_named, rig_named, survey_of
from tdfscal.errors import UsageError
from tdfscal.files.output_places import check_folder
from tdfscal.files.saving import make_folder
from tdfscal.files.writers.rows import save_rows
from tdfscal.records import FloatArray
from tdfscal.reporting import stakes, studies
from tdfscal.reporting.terminal import show
from tdfscal.simulation import Options
from tdfscal.studies.accuracy import Setup, accuracy
from tdfscal.studies.sensitivity import Sweep, sensitivity
from tdfscal.studies.wrench_error import stake


def run_sensitivity(
    rig: Path,
    folder: Path,
    *,
    calibrations: Sequence[Path],
    rpy: str | None,
    squeeze: float,
    span: float,
    json: bool,
) -> None:
    """Sweep, print, write tables and figures."""
    loaded = rig_named(rig)
    record = loaded.rig
    named = calibrations_named(calibrations, loaded)
    postures = [np.zeros(3)]
    if rpy is not None:
        postures.append(triple(rpy, "--rpy"))
    forces = [0.0, squeeze] if squeeze > 0.0 else [0.0]
    sweeps = [
        sensitivity(record, posture, internal=internal, span=span)
        for posture in postures
        for internal in forces
    ]
    worth = {
        name: [
            stake(record, c.rotation, c.rotation_covariance, sweep.rpy, internal=sweep.internal)
            for sweep in sweeps
        ]
        for name, c in named.items()
    }
    files = _write_sensitivity(record.supports, sweeps, make_folder(folder))
    if worth:
        save_rows(folder / "calibrations.csv", stakes.stake_rows(record.supports, worth))
        files.append("calibrations.csv")
    if json:
        found = studies.sensitivity_document(record.name, record.supports, sweeps, files)
        emit(found | {"calibrations": stakes.stakes_document(worth)})
        return
    tables = stakes.stakes_tables(record.supports, worth)
    show(studies.sensitivity_report(record.supports, sweeps, tables))
    print(f"\nwrote {len(files)} files to {folder}")


def _write_sensitivity(supports: tuple[str, ...], sweeps: list[Sweep], folder: Path) -> list[str]:
    from tdfscal.reporting.figures.style import save
    from tdfscal.reporting.studyfigures import sensitivity_drawing

    save_rows(folder / "sensitivity.csv", studies.sensitivity_rows(supports, sweeps))
    files = ["sensitivity.csv"]
    for sweep in sweeps:
        name = "sensitivity-tilted" if np.any(sweep.rpy) else "sensitivity-aligned"
        name += "-squeezed" if sweep.internal > 0.0 else ""
        files += [path.name for path in save(sensitivity_drawing(supports, sweep, name), folder)]
    return files


def run_accuracy(
    rig: Path,
    folder: Path,
    *,
    calibrations: Sequence[Path],
    runs: int,
    postures: int,
    tilt: float,
    squeeze: float,
    stiffness: float,
    distance: float,
    seed: int,
    workers: int | None,
    json: bool,
    quiet: bool,
) -> None:
    """Simulate and calibrate, print Table 2, write tables and figures."""
    from tdfscal.reporting.figures.style import save
    from tdfscal.reporting.studyfigures import accuracy_drawings

    loaded = rig_named(rig)
    stated = {k: c.rpy_std for k, c in calibrations_named(calibrations, loaded).items()}
    setup = Setup(
        rig=loaded.rig,
        options=Options(
            postures=postures, tilt=float(np.deg2rad(tilt)), squeeze=squeeze, stiffness=stiffness
        ),
        survey=survey_of(loaded, distance),
        runs=runs,
        seed=seed,
    )
    check_folder(folder)
    say = speaker(quiet=quiet)
    study = accuracy(
        setup,
        workers=workers or os.cpu_count() or 1,
        progress=lambda done: say(f"{done} of {runs} campaigns"),
    )
    make_folder(folder)
    tables = {
        "accuracy.csv": studies.accuracy_rows(study),
        "histograms.csv": studies.histogram_rows(study),
        "errors.csv": studies.error_rows(study),
    }
    for name, rows in tables.items():
        save_rows(folder / name, rows)
    files = list(tables)
    for drawing in accuracy_drawings(study):
        files += [path.name for path in save(drawing, folder)]
    if json:
        found = studies.accuracy_document(study, files)
        emit(found | {"calibrations": stakes.stated_document(study, stated)})
        return
    show(studies.accuracy_report(study, stakes.stated_against(study, stated)))
    print(f"\nwrote {len(files)} files to {folder}")


def triple(text: str, option: str) -> FloatArray:
    """Roll, pitch, yaw (3,), rad, as an option writes them. Raises UsageError."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise UsageError(
            f"{text!r} is not roll, pitch, yaw", where=option, hint="write radians as 0.1,0,0"
        )
    return values
