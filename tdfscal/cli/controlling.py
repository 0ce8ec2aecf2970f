"""`tdfscal study free-space` and `tdfscal study docking`."""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.cli.app import emit
from tdfscal.cli.rigs import rig_named
from tdfscal.errors import UsageError
from tdfscal.files.calibration import load_calibration
from tdfscal.files.campaign_writer import LogFormat
from tdfscal.files.control_logs import write_control_logs
from tdfscal.files.inuse import calibrated
from tdfscal.files.rows_writer import save_rows
from tdfscal.files.saving import make_folder
from tdfscal.filtering import Walk
from tdfscal.records import FloatArray, Log, Rig, Series
from tdfscal.reporting import controlstudies as words
from tdfscal.reporting.figures.style import Drawing
from tdfscal.simulation.control.loop import Controller
from tdfscal.studies import docking, freespace
from tdfscal.studies.controllers import Arms, given, simulated

LOG_FORMATS = ("csv", "parquet", "mcap")
#: Rows of a lane in traces.csv at most, about.
_TRACE_ROWS = 600


def run_free_space(
    rig: Path,
    folder: Path,
    *,
    calibrations: list[Path],
    runs: int,
    seed: int,
    tare: bool,
    moves: Path | None,
    kalman: float | None,
    logs: str | None,
    json: bool,
    quiet: bool,
) -> None:
    """Move, print, write tables and figures."""
    from tdfscal.reporting.controlfigures import free_space_drawings

    record, form = rig_named(rig).rig, _log_format(logs)
    table = freespace.MOVES.copy() if moves is None else read_moves(moves)
    controller = _controller(tare, kalman)
    setup = freespace.Setup(record, controller=controller, moves=table)
    say = _speaker(quiet)
    arm_seed, study_seed = np.random.SeedSequence(seed).spawn(2)
    arms = _arms(record, calibrations, runs, arm_seed, say)
    say(f"{len(table)} moves × {runs} runs × {len(arms.arms)} calibrations")
    study = freespace.free_space(setup, arms, study_seed, seed)
    tables = {"deviations.csv": words.free_space_rows(study)}
    files = _write(folder, tables, free_space_drawings(study), study)
    if form:
        files += _logs(folder, record, study, form)
    if json:
        emit(words.free_space_document(study, files))
        return
    sys.stdout.write(words.free_space_text(study))
    print(f"\nwrote {len(files)} files to {folder}")


def run_docking(
    rig: Path,
    folder: Path,
    *,
    calibrations: list[Path],
    runs: int,
    seed: int,
    tare: bool,
    engagement: float | None,
    kalman: float | None,
    logs: str | None,
    json: bool,
    quiet: bool,
) -> None:
    """Dock, print, write tables and figures."""
    from tdfscal.reporting.controlfigures import docking_drawings

    record, form = rig_named(rig).rig, _log_format(logs)
    setup = docking.Setup(record, controller=_controller(tare, kalman))
    if engagement is not None:
        setup = replace(setup, gears=replace(setup.gears, length=1e-3 * engagement))
    say = _speaker(quiet)
    arm_seed, study_seed = np.random.SeedSequence(seed).spawn(2)
    arms = _arms(record, calibrations, runs, arm_seed, say)
    say(f"docking, {runs} runs × {len(arms.arms)} calibrations")
    study = docking.docking(setup, arms, study_seed, seed)
    tables = {"maxima.csv": words.docking_rows(study)}
    files = _write(folder, tables, docking_drawings(study), study)
    if form:
        files += _logs(folder, record, study, form)
    if json:
        emit(words.docking_document(study, files))
        return
    sys.stdout.write(words.docking_text(study))
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


def _controller(tare: bool, kalman: float | None) -> Controller:
    base = Controller()
    sensing = base.sensing
    if kalman is not None:
        if not 0.0 < kalman < np.inf:
            raise UsageError(
                f"the force walks by {kalman:g} N in a second", where="--filter", hint="above zero"
            )
        q = np.array([kalman**2 / sensing.rate])
        walk = Walk(q=q, r=np.array([sensing.noise**2]))
        sensing = replace(sensing, gain=float(walk.gain[0]))
        print(
            f"tdfscal: the Kalman filter delays the wrench by "
            f"{1e3 * walk.delay[0] / sensing.rate:.1f} ms and leaves "
            f"{100 * walk.reduction[0]:.0f} % of the noise",
            file=sys.stderr,
        )
    return replace(base, sensing=sensing, tare=base.tare if tare else 0.0)


def _arms(
    rig: Rig,
    calibrations: list[Path],
    runs: int,
    seed: np.random.SeedSequence,
    say: Callable[[str], None],
) -> Arms:
    rng = np.random.default_rng(seed)
    if not calibrations:
        say(f"{runs} campaigns and surveys, simulated and calibrated")
        return simulated(rig, runs, rng)
    named: dict[str, Any] = {}
    for path in calibrations:
        name = path.stem if path.stem not in (*named, "none") else f"{path.stem}-{len(named) + 1}"
        named[name] = calibrated(load_calibration(path), path)
    return given(rig, list(named.items()), runs, rng)


def _speaker(quiet: bool) -> Callable[[str], None]:
    started = time.monotonic()

    def say(text: str) -> None:
        if not quiet:
            passed = time.monotonic() - started
            print(f"[{passed:5.1f} s] {text}", file=sys.stderr, flush=True)

    return say


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


def _log_format(name: str | None) -> LogFormat | None:
    if name is None:
        return None
    if name not in LOG_FORMATS:
        raise UsageError(
            f"there is no log format {name!r}",
            where="--logs",
            hint=f"choose from {', '.join(LOG_FORMATS)}",
        )
    return name  # type: ignore[return-value]


def _logs(folder: Path, rig: Rig, study: words.Study, form: LogFormat) -> list[str]:
    """One log per lane in the folder's `logs`."""
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
