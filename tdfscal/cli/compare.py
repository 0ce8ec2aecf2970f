"""`tdfscal compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CHECK


@command(CHECK, "compare last-month.yaml calibration.yaml")
def compare(
    files: Annotated[
        list[Path], typer.Argument(metavar="A B…", help="Calibration files of one rig.")
    ],
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict."""
    return perform("compare", locals()).exit_status
