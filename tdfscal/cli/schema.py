"""`tdfscal schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Quiet, app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import USE, example


@app.command(rich_help_panel=USE, epilog=example("tdfscal schema schemas"))
def schema(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write.")] = Path(
        "schemas"
    ),
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Write the JSON Schemas of the rig, calibration and point files."""
    return perform("schema", locals()).exit_status
