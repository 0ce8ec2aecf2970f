"""`tdfscal report`: options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app


@app.command()
def report(
    files: Annotated[list[Path], typer.Argument(metavar="FILE…", help="Calibration files.")],
    json: Json = False,
) -> None:
    """Summarise a calibration file, or several side by side."""
    from tdfscal.cli.reporting import run

    run(files, json=json)
