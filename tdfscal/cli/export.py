"""`tdfscal export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import USE

Target = Literal["urdf", "ros", "ros-parameters", "ros-launch", "csv", "c", "dcc", "certificate"]


@command(USE, "export calibration.yaml --to urdf -o sensors.urdf")
def export(
    calibration: options.CalibrationFile,
    to: Annotated[Target, typer.Option("--to", case_sensitive=False, help="Format.")],
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
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Write the rotations for a controller: URDF, ROS, CSV, C, or a draft certificate."""
    return perform("export", locals(), dash={"output": "content"}).exit_status
