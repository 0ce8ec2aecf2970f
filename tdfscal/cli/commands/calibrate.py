"""`tdfscal calibrate`: options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Paths, Quiet, RigFile, Seed, app


class Method(StrEnum):
    """Calibration methods."""

    SELF = "self"
    TRACKER = "tracker"
    JOINT = "joint"


class Estimator(StrEnum):
    """Estimators of the self-calibration."""

    ML = "ml"
    LINEAR = "linear"


@app.command()
def calibrate(
    paths: Paths,
    rig: RigFile = None,
    method: Annotated[
        Method | None, typer.Option(help="Default: self where there is a log, else tracker.")
    ] = None,
    estimator: Annotated[
        Estimator, typer.Option(help="Maximum likelihood, or the paper's linear method.")
    ] = Estimator.ML,
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
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Also write a report page.")
    ] = None,
    quiet: Quiet = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Say which stretches of rest were left out.")
    ] = False,
) -> None:
    """Calibrate the sensors of a rig from a recorded campaign."""
    from tdfscal.cli.calibrating import run

    status = run(
        paths,
        rig=rig,
        method=method.value if method else None,
        estimator=estimator.value,
        trials=trials,
        seed=seed,
        output=output,
        json=json,
        allow_rejected=allow_rejected,
        salvage=salvage,
        html=html,
        quiet=quiet,
        verbose=verbose,
    )
    raise typer.Exit(status)
