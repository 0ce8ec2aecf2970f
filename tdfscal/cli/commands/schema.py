"""`tdfscal schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app, emit


@app.command()
def schema(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write.")] = Path(
        "schemas"
    ),
    json: Json = False,
) -> None:
    """Write the JSON Schemas of the rig, calibration and point files."""
    from tdfscal.files.schema import write_schemas

    files = [str(path) for path in write_schemas(folder)]
    if json:
        emit({"files": files})
    else:
        print("\n".join(files))
