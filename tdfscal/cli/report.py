"""`tdfscal report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CALIBRATE


@command(CALIBRATE, "report calibration.yaml --html report.html")
def report(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Calibration files; - for stdin.")
    ],
    previous: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The calibration before: what was found, what is left."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", metavar="FILE", help="Also write one HTML page; - for stdout."),
    ] = None,
    figures: options.Figures = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Summarise a calibration file, or several side by side and over time."""
    return perform("report", locals(), dash={"html": "html"}).exit_status
