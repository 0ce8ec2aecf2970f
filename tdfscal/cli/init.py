"""`tdfscal init`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import From, Json, Paths, Quiet, To, app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CALIBRATE, example


@app.command(
    rich_help_panel=CALIBRATE, epilog=example("tdfscal init campaign/log.csv -o campaign/rig.yaml")
)
def init(
    paths: Paths,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Default: stdout (-).")
    ] = Path("-"),
    from_: From = None,
    to: To = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Write a complete, commented rig.yaml from a log; what to confirm is marked in it."""
    return perform("init", locals(), dash={"output": "yaml"}).exit_status
