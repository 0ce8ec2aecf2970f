"""`tdfscal schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import app


@app.command()
def schema(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write.")] = Path(
        "schemas"
    ),
) -> None:
    """Write the JSON Schemas of the rig, calibration and point files."""
    from tdfscal.files.schema import write_schemas

    for path in write_schemas(folder):
        print(path)
