"""`tdfscal update`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import judged, perform
from tdfscal.cli.words import CALIBRATE


@command(CALIBRATE, "update calibration.yaml this-month -o updated.yaml")
def update(
    calibration: options.CalibrationFile,
    paths: options.Paths,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="File to write; - for stdout.")
    ],
    rig: options.RigFile = None,
    from_: options.From = None,
    to: options.To = None,
    trials: options.Trials = None,
    seed: options.Seed = 0,
    json: options.Json = False,
    allow_rejected: options.AllowRejected = False,
    salvage: options.Salvage = False,
    html: options.Html = None,
    quiet: options.Quiet = False,
) -> int:
    """Bring a calibration up to date with a new campaign: zeros, load, angles."""
    result = perform("update", locals(), dash={"output": "content"})
    return judged(result, page=html is not None, written=allow_rejected)
