"""`tdfscal compare`: options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app


@app.command()
def compare(
    files: Annotated[
        list[Path], typer.Argument(metavar="A B…", help="Calibration files of one rig.")
    ],
    json: Json = False,
) -> None:
    """Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict."""
    from tdfscal.cli.reporting import compare as run

    run(files, json=json)
