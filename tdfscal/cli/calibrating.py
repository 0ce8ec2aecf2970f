"""`tdfscal calibrate`."""

from __future__ import annotations

import sys
from pathlib import Path

from tdfscal.cli.app import command_line
from tdfscal.cli.progress import reading_bar, stages
from tdfscal.cli.reporting import page_of
from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import dump_calibration, save_calibration
from tdfscal.files.output_places import check_place
from tdfscal.files.saving import write_text
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.terminal import show
from tdfscal.reporting.text import render
from tdfscal.selfcal.pipeline import Estimator
from tdfscal.workflows.calibrate import Method, calibrate
from tdfscal.workflows.campaign import find_logs

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
    if str(html) == "-":
        raise UsageError("--html - and the result both want standard output", hint="name a file")
    _check_name(target)
    for place in (target, html):
        if place is not None:
            check_place(place, [*paths, *([rig] if rig else [])])
    progress = stages(quiet=quiet)
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
    page = None
    if html is not None and write:
        progress("drawing the report")
        page = page_of(("", result))
    if write and not to_stdout:
        save_calibration(result, target)
    if html is not None and page is not None:
        write_text(html, page)
    if json:
        sys.stdout.write(dump_calibration(result, "json"))
    elif to_stdout:
        sys.stdout.write(
            dump_calibration(result, "yaml") if write else render(calibration_report(result))
        )
    else:
        show(calibration_report(result))
        if write:
            print(f"\nwrote {target}")
    if verbose and outcome.own is not None:
        for stretch in outcome.own.dwells.left_out:
            span = f"{stretch.start:.2f} to {stretch.end:.2f} s"
            print(f"left out: {span}: {stretch.reason}", file=sys.stderr)
    if not accepted:
        what = "it was written as rejected" if write and not to_stdout else "nothing was written"
        if html is not None and not write:
            what += " (--allow-rejected writes result and page)"
        print(f"tdfscal: the quality gate rejects this result; {what}", file=sys.stderr)
    return 0 if accepted else 1


def _check_name(target: Path) -> None:
    if str(target) != "-" and target.suffix.lower() not in SUFFIXES:
        raise UsageError(
            "a calibration file's name ends in .json, .yaml or .yml",
            where=str(target),
            hint="choose one of them",
        )
