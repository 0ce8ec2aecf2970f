"""`tdfscal study free-space` and `tdfscal study docking`."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tdfscal.cli.app import emit
from tdfscal.cli.progress import speaker
from tdfscal.cli.rigs import calibrations_named, rig_named, survey_of
from tdfscal.cli.studying import triple
from tdfscal.errors import UsageError
from tdfscal.files.output_places import check_folder
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.saving import make_folder
from tdfscal.files.writers.campaign import LogFormat
from tdfscal.files.writers.control_logs import write_control_logs
from tdfscal.files.writers.rows import save_rows
from tdfscal.records import FloatArray, Log, Rig, Series
from tdfscal.reporting import controlstudies as words
from tdfscal.reporting.figures.style import Drawing
from tdfscal.reporting.layout import Report
from tdfscal.reporting.terminal import show
from tdfscal.simulation import Options
from tdfscal.simulation.control.runs import Controller
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import MOUNTING, SQUEEZE, Arms, drifted, given, simulated
from tdfscal.workflows.calibration_in_use import calibrated
from tdfscal.wrench.filtering import Walk, checked_walk

_S = TypeVar("_S", docking.DockingStudy, free_space.FreeSpaceStudy)
#: Tare, s, where the user asks for one.
TARE = 2.0
#: Rows of a lane in traces.csv at most, about.
_TRACE_ROWS = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices:
    """The options that both studies share, as on the command line."""

    calibrations: list[Path]
    runs: int
    perfect: bool
    mounting: str | None
    drift: float
    tare: bool
    filter: str
    walk: float | None
    logs: LogFormat | None
    seed: int
    json: bool
    quiet: bool


def run_free_space(rig: Path, folder: Path, choices: Choices, moves: Path | None) -> None:
    """Move, print, write tables and figures."""
    from tdfscal.reporting.controlfigures import free_space_drawings

    loaded = rig_named(rig)
    table = free_space.MOVES.copy() if moves is None else read_moves(moves)
    setup = free_space.Setup(loaded.rig, controller=_controller(choices), moves=table)
    check_folder(folder)
    arms, seed, say = _arms(loaded, choices)
    say(f"{len(table)} moves × {choices.runs} runs × {len(arms.arms)} calibrations")
    study = free_space.free_space(setup, arms, seed, choices.seed)
    tables = {"deviations.csv": words.free_space_rows(study)}
    files = _write(folder, tables, free_space_drawings(study), study)
    files += _logs(folder, loaded.rig, study, choices.logs)
    _tell(choices, folder, files, study, words.free_space_document, words.free_space_report)


def run_docking(rig: Path, folder: Path, choices: Choices, engagement: float | None) -> None:
    """Dock, print, write tables and figures."""
    from tdfscal.reporting.controlfigures import docking_drawings

    loaded = rig_named(rig)
    setup = docking.Setup(loaded.rig, controller=_controller(choices))
    if engagement is not None:
        setup = replace(setup, gears=replace(setup.gears, length=1e-3 * engagement))
    check_folder(folder)
    arms, seed, say = _arms(loaded, choices)
    say(f"docking, {choices.runs} runs × {len(arms.arms)} calibrations")
    study = docking.docking(setup, arms, seed, choices.seed)
    tables = {"maxima.csv": words.docking_rows(study)}
    files = _write(folder, tables, docking_drawings(study), study)
    files += _logs(folder, loaded.rig, study, choices.logs)
    _tell(choices, folder, files, study, words.docking_document, words.docking_report)


def _tell(
    choices: Choices,
    folder: Path,
    files: list[str],
    study: _S,
    document: Callable[[_S, list[str]], dict[str, Any]],
    report: Callable[[_S], Report],
) -> None:
    if choices.json:
        emit(document(study, files))
        return
    show(report(study))
    print(f"\nwrote {len(files)} files to {folder}")


def read_moves(path: Path) -> FloatArray:
    """Moves (M, 2, 6) from CSV: initial and target roll, pitch, yaw (rad) and x, y, z (m, from
    home), one move per row under a header. Raises UsageError.
    """
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.reader(stream) if row][1:]
        moves = np.array([[float(cell) for cell in row] for row in rows])
    except OSError as fault:
        raise UsageError("cannot be read", where=str(path), hint="name a CSV file") from fault
    except ValueError as fault:
        raise UsageError(
            f"holds no table of numbers: {fault}", where=str(path), hint=_MOVES_HINT
        ) from fault
    if moves.ndim != 2 or moves.shape[1] != 12 or not np.all(np.isfinite(moves)):
        raise UsageError("is no table of moves", where=str(path), hint=_MOVES_HINT)
    return moves.reshape(-1, 2, 6)


_MOVES_HINT = (
    "write a header and 12 numbers per row: initial and target roll, pitch, yaw (rad), x, y, z (m)"
)


def _controller(choices: Choices) -> Controller:
    base = Controller(tare=TARE if choices.tare else 0.0)
    walk = checked_walk(choices.filter, choices.walk)
    if walk is None:
        return base
    sensing = base.sensing
    model = Walk.of(walk, sensing.noise, 1.0 / sensing.rate)
    return replace(base, sensing=replace(sensing, gain=model.gain))


def _arms(
    loaded: LoadedRig, choices: Choices
) -> tuple[Arms, np.random.SeedSequence, Callable[[str], None]]:
    """Calibrations and machines, the seed of the study itself, and how to speak of it."""
    arm_seed, study_seed = np.random.SeedSequence(choices.seed).spawn(2)
    rng, runs, rig = np.random.default_rng(arm_seed), choices.runs, loaded.rig
    say = speaker(quiet=choices.quiet)
    if not choices.calibrations:
        mounting = MOUNTING
        if choices.mounting is not None:
            roll, pitch, yaw = np.abs(triple(choices.mounting, "--mounting")).tolist()
            mounting = (roll, pitch, yaw)
        say(f"{runs} campaigns and surveys, simulated and calibrated")
        options = Options(squeeze=SQUEEZE, installation_std=mounting)
        survey = survey_of(loaded)
        arms = simulated(rig, runs, rng, best=choices.perfect, options=options, survey=survey)
        return _drifted(arms, choices.drift, rng), study_seed, say
    if choices.mounting is not None:
        raise UsageError(
            "given calibrations say how the sensors are mounted",
            where="--mounting",
            hint="leave it out, or leave --calibration out",
        )
    named = calibrations_named(choices.calibrations, loaded, ("none", "perfect"))
    each = [(name, calibrated(calibration, name)) for name, calibration in named.items()]
    arms = given(rig, each, runs, rng, best=choices.perfect)
    return _drifted(arms, choices.drift, rng), study_seed, say


def _drifted(arms: Arms, drift: float, rng: np.random.Generator) -> Arms:
    return drifted(arms, drift, rng) if drift else arms


def _write(
    folder: Path,
    tables: dict[str, Iterator[words.Row]],
    drawings: Iterable[Drawing],
    study: words.Study,
) -> list[str]:
    from tdfscal.reporting.figures.style import save

    make_folder(folder)
    each = -(-len(study.result.traces.time) // _TRACE_ROWS)
    tables = {**tables, "traces.csv": words.trace_rows(study, each)}
    for name, rows in tables.items():
        save_rows(folder / name, rows)
    files = list(tables)
    for drawing in drawings:
        files += [path.name for path in save(drawing, folder)]
    return files


def _logs(folder: Path, rig: Rig, study: words.Study, form: LogFormat | None) -> list[str]:
    """One log per lane in the folder's `logs`."""
    if form is None:
        return []
    traces = study.result.traces
    lanes = traces.contact.shape[1]
    per = lanes // len(study.names)
    logs = []
    for lane in range(lanes):
        log = Log(
            supports=rig.supports,
            position=tuple(Series(traces.time, traces.servo[:, lane, i]) for i in range(rig.n)),
            force=tuple(Series(traces.time, traces.reading[:, lane, i]) for i in range(rig.n)),
        )
        logs.append((f"{study.names[lane // per]}-{lane % per + 1:02d}", log))
    return [f"logs/{name}" for name in write_control_logs(folder / "logs", rig, logs, form)]
