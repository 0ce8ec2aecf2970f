"""`tdfscal init`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CALIBRATE


@command(CALIBRATE, "init campaign/log.csv -o campaign/rig.yaml")
def init(
    paths: options.Paths,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Default: stdout (-).")
    ] = Path("-"),
    from_: options.From = None,
    to: options.To = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Write a complete, commented rig.yaml from a log; what to confirm is marked in it."""
    return perform("init", locals(), dash={"output": "yaml"}).exit_status
