"""`tdfscal validate`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from tdfscal.cli.app import (
    CalibrationFile,
    Figures,
    From,
    Html,
    Json,
    Paths,
    Quiet,
    RigFile,
    To,
    app,
)
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CHECK, example

Samples = Literal["static", "moving"]


@app.command(
    rich_help_panel=CHECK,
    epilog=example("tdfscal validate calibration.yaml check --html check.html"),
)
def validate(
    calibration: CalibrationFile,
    paths: Paths,
    rig: RigFile = None,
    samples: Annotated[
        Samples | None,
        typer.Option(
            case_sensitive=False, help="Default: static where there are three dwells, else moving."
        ),
    ] = None,
    from_: From = None,
    to: To = None,
    html: Html = None,
    figures: Figures = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Check a calibration on postures or on a motion without contact: valid, or what changed."""
    return perform("validate", locals()).exit_status
