"""`tdfscal calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import judged, perform
from tdfscal.cli.streams import say
from tdfscal.cli.words import CALIBRATE

if TYPE_CHECKING:
    from tdfscal.workflows.calibration import Calibration

DEFAULT_OUTPUT = Path("calibration.yaml")
Method = Literal["self", "tracker", "joint"]
Samples = Literal["static", "moving", "all"]
Estimator = Literal["ml", "linear"]


@command(CALIBRATE, "calibrate campaign -o calibration.yaml --html report.html")
def calibrate(
    paths: options.Paths,
    rig: options.RigFile = None,
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
    from_: options.From = None,
    to: options.To = None,
    trials: options.Trials = None,
    seed: options.Seed = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Default: calibration.yaml here; - for stdout."
        ),
    ] = None,
    json: options.Json = False,
    allow_rejected: options.AllowRejected = False,
    salvage: options.Salvage = False,
    html: options.Html = None,
    figures: options.Figures = None,
    quiet: options.Quiet = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Say which stretches of rest were left out.")
    ] = False,
) -> int:
    """Calibrate the sensors of a rig from a recorded campaign."""
    asked = locals()
    del asked["verbose"]
    asked["output"] = output or DEFAULT_OUTPUT
    result = cast("Calibration", perform("calibrate", asked, dash={"output": "content"}))
    if verbose and result.records is not None and result.records.own is not None:
        for stretch in result.records.own.dwells.left_out:
            span = f"{stretch.start:.2f} to {stretch.end:.2f} s"
            say(f"left out: {span}: {stretch.reason}")
    return judged(result, page=html is not None, written=allow_rejected)
