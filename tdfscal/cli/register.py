"""`tdfscal register`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app
from tdfscal.cli.perform import perform


@app.command()
def register(
    measured: Annotated[Path, typer.Argument(metavar="MEASURED", help="Point file, moved.")],
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="Point file, to move.")],
    unit: Annotated[
        str | None, typer.Option("--unit", metavar="U", help="Of files that name none: m, mm, in …")
    ] = None,
    json: Json = False,
) -> int:
    """Fit the rigid transform from reference points to measured ones, with its uncertainty."""
    return perform("register", locals()).exit_status
