"""`tdfscal register`: options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app


@app.command()
def register(
    measured: Annotated[Path, typer.Argument(metavar="MEASURED", help="Point file, moved.")],
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="Point file, to move.")],
    unit: Annotated[
        str | None, typer.Option("--unit", metavar="U", help="Of files that name none: m, mm, in …")
    ] = None,
    json: Json = False,
) -> None:
    """Fit the rigid transform from reference points to measured ones, with its uncertainty."""
    from tdfscal.cli.registering import run

    run(measured, reference, unit=unit, json=json)
