"""`tdfscal apply`: options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Paths, Quiet, RigFile, app


class Filter(StrEnum):
    """Filters of the sensors' signals."""

    NONE = "none"
    KALMAN = "kalman"
    SMOOTH = "smooth"


@app.command()
def apply(
    calibration: Annotated[Path, typer.Argument(metavar="CALIBRATION", help="Calibration file.")],
    paths: Paths,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="Result: .csv or .parquet."),
    ],
    rig: RigFile = None,
    quasi_static: Annotated[
        bool,
        typer.Option("--quasi-static", help="Leave inertia out although the rig file states it."),
    ] = False,
    filter: Annotated[
        Filter,
        typer.Option(help="Kalman filter: causal, as a controller's; or smoothed, without delay."),
    ] = Filter.NONE,
    walk: Annotated[
        float | None,
        typer.Option(metavar="N", help="What a force may walk by in 1 s, for the filter; 15 N."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Work out the contact force and torque over a whole log."""
    from tdfscal.cli.applying import run

    run(
        calibration,
        paths,
        output=output,
        rig=rig,
        quasi_static=quasi_static,
        filter=filter.value,
        walk=walk,
        json=json,
        quiet=quiet,
    )
