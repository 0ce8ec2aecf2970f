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


@study.command()
def sensitivity(
    rig: Rig,
    output: Folder,
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
    run_sensitivity(rig, output, rpy=rpy, squeeze=squeeze, span=span, json=json)


@study.command()
def accuracy(
    rig: Rig,
    output: Folder,
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


Calibrations = Annotated[
    list[Path] | None,
    typer.Option("--calibration", metavar="FILE", help="Calibration file; may be repeated."),
]
Kalman = Annotated[
    float | None,
    typer.Option("--filter", metavar="N", help="Kalman filter: the force walks by N in 1 s."),
]
Logs = Annotated[
    str | None,
    typer.Option("--logs", metavar="FORMAT", help="Write each run's log: csv, parquet, mcap."),
]
Runs = Annotated[int, typer.Option(min=1, help="Runs per calibration.")]


@study.command("free-space")
def free_space(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    runs: Runs = 10,
    moves: Annotated[
        Path | None, typer.Option(metavar="FILE", help="CSV of moves instead of the six stated.")
    ] = None,
    tare: Annotated[bool, typer.Option(help="Tare the wrench at the start.")] = False,
    filter_walk: Kalman = None,
    logs: Logs = None,
    seed: Seed = 0,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Deviation of the terminal in free space under impedance control (Table 4, Fig. 16)."""
    from tdfscal.cli.controlling import run_free_space

    run_free_space(
        rig,
        output,
        calibrations=calibration or [],
        runs=runs,
        seed=seed,
        tare=tare,
        moves=moves,
        kalman=filter_walk,
        logs=logs,
        json=json,
        quiet=quiet,
    )


@study.command()
def docking(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    runs: Runs = 10,
    engagement: Annotated[
        float | None, typer.Option(metavar="MM", help="Length of the engagement, default 333 mm.")
    ] = None,
    tare: Annotated[bool, typer.Option(help="Tare the wrench at the start.")] = True,
    filter_walk: Kalman = None,
    logs: Logs = None,
    seed: Seed = 0,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Contact force and torque while the gears are docked (Figs. 17 and 18)."""
    from tdfscal.cli.controlling import run_docking

    run_docking(
        rig,
        output,
        calibrations=calibration or [],
        runs=runs,
        seed=seed,
        tare=tare,
        engagement=engagement,
        kalman=filter_walk,
        logs=logs,
        json=json,
        quiet=quiet,
    )
