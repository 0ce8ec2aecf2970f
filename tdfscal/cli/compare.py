"""`tdfscal compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Quiet, app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CHECK, example


@app.command(
    rich_help_panel=CHECK, epilog=example("tdfscal compare last-month.yaml calibration.yaml")
)
def compare(
    files: Annotated[
        list[Path], typer.Argument(metavar="A B…", help="Calibration files of one rig.")
    ],
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict."""
    return perform("compare", locals()).exit_status
