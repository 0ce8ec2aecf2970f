"""`tdfscal monitor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CHECK


@command(CHECK, "monitor 2026-*.yaml --html history.html")
def monitor(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE…", help="Calibration files and campaign folders of one rig."),
    ],
    rate: Annotated[
        float, typer.Option(help="False alarms per year where nothing changes.")
    ] = 0.005,
    from_: options.From = None,
    to: options.To = None,
    since: Annotated[
        str | None, typer.Option(metavar="DATE", help="Alarms raised before count no more.")
    ] = None,
    html: options.Html = None,
    figures: options.Figures = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Watch a rig over time: control chart, alarms (status 1), when to calibrate next."""
    return perform("monitor", locals()).exit_status
