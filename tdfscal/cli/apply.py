"""`tdfscal apply`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import USE

Filter = Literal["none", "kalman", "smooth"]


@command(USE, "apply calibration.yaml assembly/log.csv -o wrench.csv")
def apply(
    calibration: options.CalibrationFile,
    paths: options.Paths,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="Result: .csv, .parquet or .mcap."),
    ],
    rig: options.RigFile = None,
    from_: options.From = None,
    to: options.To = None,
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
    figures: options.Figures = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Work out the contact force and torque over a whole log."""
    return perform("apply", locals()).exit_status
