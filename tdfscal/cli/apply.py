"""`tdfscal apply`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tdfscal.cli.app import CalibrationFile, Figures, From, Json, Paths, Quiet, RigFile, To, app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import USE, example

Filter = Literal["none", "kalman", "smooth"]


@app.command(
    rich_help_panel=USE,
    epilog=example("tdfscal apply calibration.yaml assembly/log.csv -o wrench.csv"),
)
def apply(
    calibration: CalibrationFile,
    paths: Paths,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="Result: .csv, .parquet or .mcap."),
    ],
    rig: RigFile = None,
    from_: From = None,
    to: To = None,
    quasi_static: Annotated[
        bool,
        typer.Option("--quasi-static", help="Leave inertia out although the rig file states it."),
    ] = False,
    filter: Annotated[
        Filter,
        typer.Option(
            case_sensitive=False,
            help="Kalman filter: causal, as a controller's; or smoothed, without delay.",
        ),
    ] = "none",
    walk: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Random-walk intensity of the contact force, for the filter; default 15 N/√s.",
        ),
    ] = None,
    at: Annotated[
        str,
        typer.Option(metavar="X,Y,Z", help="Point of the LCS that moments are about, m."),
    ] = "0,0,0",
    figures: Figures = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Work out the contact force and torque over a whole log."""
    return perform("apply", locals()).exit_status
