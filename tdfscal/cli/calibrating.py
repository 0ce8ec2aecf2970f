"""`tdfscal calibrate`."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from tdfscal.cli.app import command_line
from tdfscal.cli.progress import reading_bar
from tdfscal.cli.reporting import check_place, write_report
from tdfscal.errors import UsageError
from tdfscal.files.calibration import dump_calibration, save_calibration
from tdfscal.files.campaign import find_logs
from tdfscal.reporting.terminal import show
from tdfscal.reporting.text import render
from tdfscal.selfcalibration import Estimator
from tdfscal.workflow import Method, calibrate

DEFAULT_OUTPUT = Path("calibration.yaml")
SUFFIXES = (".yaml", ".yml", ".json")


def run(
    paths: list[Path],
    *,
    rig: Path | None,
    method: Method | None,
    estimator: Estimator,
    trials: int | None,
    seed: int,
    output: Path | None,
    json: bool,
    allow_rejected: bool,
    salvage: bool,
    html: Path | None,
    quiet: bool,
    verbose: bool,
) -> int:
    """Calibrate, print, write; return the exit status."""
    target = output or DEFAULT_OUTPUT
    to_stdout = str(target) == "-"
    _check_target(target, to_stdout=to_stdout)
    if html is not None:
        check_place(html)
    started = time.monotonic()

    def progress(stage: str) -> None:
        if not quiet:
            print(f"[{time.monotonic() - started:5.1f} s] {stage} …", file=sys.stderr, flush=True)

    with reading_bar(find_logs(paths), quiet=quiet) as reading:
        outcome = calibrate(
            paths,
            rig=rig,
            method=method,
            estimator=estimator,
            trials=trials,
            seed=seed,
            salvage=salvage,
            command=command_line(),
            progress=progress,
            reading=reading,
        )
    result = outcome.calibration
    accepted = result.status == "accepted"
    write = accepted or allow_rejected
    if json:
        sys.stdout.write(dump_calibration(result, "json"))
    elif to_stdout:
        sys.stdout.write(dump_calibration(result, "yaml") if write else render(result))
    else:
        show(result)
    if verbose and outcome.own is not None:
        for stretch in outcome.own.dwells.left_out:
            span = f"{stretch.start:.2f} to {stretch.end:.2f} s"
            print(f"left out: {span}: {stretch.reason}", file=sys.stderr)
    if html is not None:
        # A rejected result gets its page too: it says why, and what to do.
        progress("drawing the report")
        write_report(outcome, html)
    if write and not to_stdout:
        save_calibration(result, target)
        if not json:
            print(f"\nwrote {target}")
    if not accepted:
        what = "was written as rejected" if write and not to_stdout else "nothing was written"
        print(f"tdfscal: the quality gate rejects this result; {what}", file=sys.stderr)
    return 0 if accepted else 1


def _check_target(target: Path, *, to_stdout: bool) -> None:
    """Refuse before the work what could not be written after it."""
    if to_stdout:
        return
    if target.is_dir():
        raise UsageError("is a folder", where=str(target), hint="name a file in it")
    if target.suffix.lower() not in SUFFIXES:
        raise UsageError(
            "a calibration file's name ends in .json, .yaml or .yml",
            where=str(target),
            hint="choose one of them",
        )
    if not target.absolute().parent.is_dir():
        raise UsageError(
            "the folder for the result does not exist", where=str(target), hint="create it first"
        )
    if not os.access(target.absolute().parent, os.W_OK):
        raise UsageError(
            "the folder for the result cannot be written",
            where=str(target),
            hint="choose another with -o",
        )
