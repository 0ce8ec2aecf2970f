"""`tdfscal validate`: options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Paths, Quiet, RigFile, app


@app.command()
def validate(
    calibration: Annotated[Path, typer.Argument(metavar="CALIBRATION", help="Calibration file.")],
    paths: Paths,
    rig: RigFile = None,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Also write a report page.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check a calibration on static postures without contact: still valid, or what changed."""
    from tdfscal.cli.validating import run

    raise typer.Exit(run(calibration, paths, rig=rig, html=html, json=json, quiet=quiet))
