"""`tdfscal study sensitivity` and `tdfscal study accuracy`."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

from tdfscal.cli.app import emit
from tdfscal.cli.rigs import rig_named
from tdfscal.errors import UsageError
from tdfscal.files.rig import LoadedRig
from tdfscal.files.rows_writer import save_rows
from tdfscal.files.saving import make_folder
from tdfscal.reporting import studies
from tdfscal.simulation import Options, SurveyOptions
from tdfscal.studies.accuracy import Setup, accuracy
from tdfscal.studies.sensitivity import Sweep, sensitivity


def run_sensitivity(
    rig: Path, folder: Path, *, rpy: str | None, squeeze: float, span: float, json: bool
) -> None:
    """Sweep, print, write tables and figures."""
    record = rig_named(rig).rig
    postures = [np.zeros(3)]
    if rpy is not None:
        postures.append(_rpy(rpy))
    forces = [0.0, squeeze] if squeeze > 0.0 else [0.0]
    sweeps = [
        sensitivity(record, posture, internal=internal, span=span)
        for posture in postures
        for internal in forces
    ]
    files = _write_sensitivity(record.supports, sweeps, make_folder(folder))
    if json:
        emit(studies.sensitivity_document(record.name, record.supports, sweeps, files))
        return
    sys.stdout.write(studies.sensitivity_text(record.supports, sweeps))
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
    setup = Setup(
        rig=loaded.rig,
        options=Options(
            postures=postures, tilt=float(np.deg2rad(tilt)), squeeze=squeeze, stiffness=stiffness
        ),
        survey=_survey(loaded, distance),
        runs=runs,
        seed=seed,
    )
    make_folder(folder)
    started = time.monotonic()

    def progress(done: int) -> None:
        if not quiet:
            passed = time.monotonic() - started
            print(f"[{passed:5.1f} s] {done} of {runs} campaigns", file=sys.stderr, flush=True)

    study = accuracy(setup, workers=workers or os.cpu_count() or 1, progress=progress)
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
        emit(studies.accuracy_document(study, files))
        return
    sys.stdout.write(studies.accuracy_text(study))
    print(f"\nwrote {len(files)} files to {folder}")


def _survey(loaded: LoadedRig, distance: float) -> SurveyOptions:
    """Take the survey that the rig file declares, or the paper's."""
    if not 0.0 < distance < np.inf:
        raise UsageError(f"the tracker stands {distance:g} m away", hint="give metres above zero")
    if (files := loaded.tracker) is None:
        return SurveyOptions(distance=distance)
    return SurveyOptions(
        instrument=files.instrument,
        distance=distance,
        drawing=files.drawing,
        body_misalignment=files.misalignment,
    )


def _rpy(text: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise UsageError(
            f"{text!r} is not roll, pitch, yaw", where="--rpy", hint="write radians as 0.1,0,0"
        )
    return values
