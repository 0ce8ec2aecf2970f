"""`tdfscal schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, app
from tdfscal.cli.perform import perform


@app.command()
def schema(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write.")] = Path(
        "schemas"
    ),
    json: Json = False,
) -> int:
    """Write the JSON Schemas of the rig, calibration and point files."""
    return perform("schema", locals()).exit_status
