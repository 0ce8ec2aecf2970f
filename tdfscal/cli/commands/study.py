"""`tdfscal study …`: options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Quiet, Seed, app

study = typer.Typer(no_args_is_help=True, help="The paper's studies, on any rig.")
app.add_typer(study, name="study")

Rig = Annotated[Path, typer.Argument(metavar="RIG", help="rig.yaml, or its folder.")]
Folder = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for tables and figures.")
]
Calibrations = Annotated[
    list[Path] | None,
    typer.Option("--calibration", metavar="FILE", help="What it is worth; may be repeated."),
]


@study.command()
def sensitivity(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    rpy: Annotated[
        str | None,
        typer.Option(metavar="R,P,Y", help="A posture beside the aligned one, rad."),
    ] = None,
    squeeze: Annotated[
        float, typer.Option(metavar="N", min=0, help="Internal forces, standard deviation, N.")
    ] = 200.0,
    span: Annotated[float, typer.Option(metavar="RAD", help="Sweep by ± this.")] = 0.05,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Contact force and torque error against each installation angle (Fig. 4)."""
    from tdfscal.cli.studying import run_sensitivity

    del seed  # nothing here is random; every study takes one
    run_sensitivity(
        rig,
        output,
        calibrations=calibration or (),
        rpy=rpy,
        squeeze=squeeze,
        span=span,
        json=json,
    )


@study.command()
def accuracy(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    runs: Annotated[int, typer.Option(min=2, help="Simulated campaigns per method.")] = 1000,
    postures: Annotated[int, typer.Option(min=1, help="Postures of a campaign.")] = 24,
    tilt: Annotated[float, typer.Option(metavar="DEG", help="Largest tilt, degrees.")] = 5.0,
    squeeze: Annotated[
        float, typer.Option(metavar="N", help="Commanded internal forces, N.")
    ] = 200.0,
    stiffness: Annotated[float, typer.Option(metavar="N/M", help="Of an NCP.")] = 20.0e6,
    distance: Annotated[float, typer.Option(metavar="M", help="Tracker to rig, m.")] = 5.0,
    seed: Seed = 0,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; default one per core.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Monte Carlo of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 2)."""
    from tdfscal.cli.studying import run_accuracy

    run_accuracy(
        rig,
        output,
        calibrations=calibration or (),
        runs=runs,
        postures=postures,
        tilt=tilt,
        squeeze=squeeze,
        stiffness=stiffness,
        distance=distance,
        seed=seed,
        workers=workers,
        json=json,
        quiet=quiet,
    )
