"""`tdfscal calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from tdfscal.cli.app import Figures, From, Html, Json, Paths, Quiet, RigFile, Seed, To, app
from tdfscal.cli.perform import perform
from tdfscal.cli.streams import say
from tdfscal.cli.words import CALIBRATE, example

if TYPE_CHECKING:
    from tdfscal.workflows.calibration import Calibration

DEFAULT_OUTPUT = Path("calibration.yaml")
Method = Literal["self", "tracker", "joint"]
Samples = Literal["static", "moving", "all"]
Estimator = Literal["ml", "linear"]


@app.command(
    rich_help_panel=CALIBRATE,
    epilog=example("tdfscal calibrate campaign -o calibration.yaml --html report.html"),
)
def calibrate(
    paths: Paths,
    rig: RigFile = None,
    method: Annotated[
        Method | None,
        typer.Option(
            case_sensitive=False, help="Default: self where there is a log, else tracker."
        ),
    ] = None,
    samples: Annotated[
        Samples | None,
        typer.Option(
            case_sensitive=False, help="Default: static where there are dwells enough, else moving."
        ),
    ] = None,
    estimator: Annotated[
        Estimator,
        typer.Option(
            case_sensitive=False, help="Maximum likelihood, or the paper's linear method."
        ),
    ] = "ml",
    from_: From = None,
    to: To = None,
    trials: Annotated[
        int | None, typer.Option(min=0, help="Monte Carlo trials at most; 0 for none.")
    ] = None,
    seed: Seed = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Default: calibration.yaml here; - for stdout."
        ),
    ] = None,
    json: Json = False,
    allow_rejected: Annotated[
        bool, typer.Option("--allow-rejected", help="Write the file even if the gate rejects it.")
    ] = False,
    salvage: Annotated[
        bool, typer.Option("--salvage", help="Read what is sound of a damaged log; never accepted.")
    ] = False,
    html: Html = None,
    figures: Figures = None,
    quiet: Quiet = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Say which stretches of rest were left out.")
    ] = False,
) -> int:
    """Calibrate the sensors of a rig from a recorded campaign."""
    options = locals()
    del options["verbose"]
    options["output"] = output or DEFAULT_OUTPUT
    result = cast("Calibration", perform("calibrate", options, dash={"output": "content"}))
    if verbose and result.records is not None and result.records.own is not None:
        for stretch in result.records.own.dwells.left_out:
            span = f"{stretch.start:.2f} to {stretch.end:.2f} s"
            say(f"left out: {span}: {stretch.reason}")
    if not result.accepted:
        nothing = "nothing was written" if html is None else "only its page was written"
        what = "it was written as rejected" if allow_rejected else nothing
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status
