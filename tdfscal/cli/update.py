"""`tdfscal update`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from tdfscal.cli.app import CalibrationFile, From, Html, Json, Paths, Quiet, RigFile, Seed, To, app
from tdfscal.cli.perform import perform
from tdfscal.cli.streams import say
from tdfscal.cli.words import CALIBRATE, example

if TYPE_CHECKING:
    from tdfscal.workflows.calibration import Calibration


@app.command(
    rich_help_panel=CALIBRATE,
    epilog=example("tdfscal update calibration.yaml this-month -o updated.yaml"),
)
def update(
    calibration: CalibrationFile,
    paths: Paths,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="File to write; - for stdout.")
    ],
    rig: RigFile = None,
    from_: From = None,
    to: To = None,
    trials: Annotated[
        int | None, typer.Option(min=0, help="Monte Carlo trials at most; 0 for none.")
    ] = None,
    seed: Seed = 0,
    json: Json = False,
    allow_rejected: Annotated[
        bool, typer.Option("--allow-rejected", help="Write the file even if the gate rejects it.")
    ] = False,
    salvage: Annotated[
        bool, typer.Option("--salvage", help="Read what is sound of a damaged log; never accepted.")
    ] = False,
    html: Html = None,
    quiet: Quiet = False,
) -> int:
    """Bring a calibration up to date with a new campaign: zeros, load, angles."""
    options = locals()
    result = cast("Calibration", perform("update", options, dash={"output": "content"}))
    if not result.accepted:
        nothing = "nothing was written" if html is None else "only its page was written"
        what = "it was written as rejected" if allow_rejected else nothing
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status
