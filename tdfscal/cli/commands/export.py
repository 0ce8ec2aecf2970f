"""`tdfscal export`: options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app


class Target(StrEnum):
    """What a calibration is exported to."""

    URDF = "urdf"
    ROS = "ros"
    CSV = "csv"
    C = "c"
    DCC = "dcc"


@app.command()
def export(
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="Calibration file; - for stdin.")
    ],
    to: Annotated[Target, typer.Option("--to", help="Format.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Default: stdout (-).")
    ] = Path("-"),
    parent: Annotated[
        str,
        typer.Option("--parent", metavar="FRAME", help="Frame with the BCS's axes (URDF, ROS)."),
    ] = "bcs",
    schema: Annotated[
        Path | None,
        typer.Option("--schema", metavar="XSD", help="Check a DCC against this schema file."),
    ] = None,
    allow_rejected: Annotated[
        bool, typer.Option("--allow-rejected", help="Export what the quality gate rejected.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the rotations for a controller: URDF, ROS, CSV, C, or a draft certificate."""
    from tdfscal.cli.exporting import run

    status = run(
        calibration,
        to=to.value,
        output=output,
        parent=parent,
        schema=schema,
        allow_rejected=allow_rejected,
        json=json,
    )
    raise typer.Exit(status)
