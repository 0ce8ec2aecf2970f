"""`tdfscal schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import USE


@command(USE, "schema schemas")
def schema(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write.")] = Path(
        "schemas"
    ),
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Write the JSON Schemas of the rig, calibration and point files."""
    return perform("schema", locals()).exit_status
