"""`tdfscal validate`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CHECK

Samples = Literal["static", "moving"]


@command(CHECK, "validate calibration.yaml check --html check.html")
def validate(
    calibration: options.CalibrationFile,
    paths: options.Paths,
    rig: options.RigFile = None,
    samples: Annotated[
        Samples | None,
        typer.Option(
            case_sensitive=False, help="Default: static where there are three dwells, else moving."
        ),
    ] = None,
    from_: options.From = None,
    to: options.To = None,
    html: options.Html = None,
    figures: options.Figures = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Check a calibration on postures or on a motion without contact: valid, or what changed."""
    return perform("validate", locals()).exit_status
