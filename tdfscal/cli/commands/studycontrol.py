"""`tdfscal study free-space` and `tdfscal study docking`: options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Quiet, Seed
from tdfscal.cli.commands.simulate import LogFormat
from tdfscal.cli.commands.study import Folder, Rig, study


class Filter(StrEnum):
    """Filters in the loop."""

    NONE = "none"
    KALMAN = "kalman"


Calibrations = Annotated[
    list[Path] | None,
    typer.Option("--calibration", metavar="FILE", help="Calibration file; may be repeated."),
]
Runs = Annotated[int, typer.Option(min=1, help="Runs per calibration.")]
Perfect = Annotated[
    bool, typer.Option("--perfect", help="Also the best that any calibration could do.")
]
Mounting = Annotated[
    str | None,
    typer.Option(
        metavar="R,P,Y",
        help="Simulated mounting: std of roll, pitch, yaw, rad; default 0.003,0.003,0.03.",
    ),
]
Drift = Annotated[
    float, typer.Option(metavar="N", min=0, help="Std of the zeros' drift since the calibration.")
]
Tare = Annotated[bool, typer.Option(help="Tare the wrench at the start.")]
Filtered = Annotated[Filter, typer.Option("--filter", help="Kalman filter of the sensors.")]
Walking = Annotated[
    float | None,
    typer.Option("--walk", metavar="N", help="What a force may walk by in 1 s, for it; 15 N."),
]
Logs = Annotated[LogFormat | None, typer.Option("--logs", help="Write each run's log.")]


@study.command("free-space")
def free_space(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    runs: Runs = 10,
    moves: Annotated[
        Path | None, typer.Option(metavar="FILE", help="CSV of moves instead of the six stated.")
    ] = None,
    perfect: Perfect = False,
    mounting: Mounting = None,
    drift: Drift = 0.0,
    tare: Tare = False,
    filtered: Filtered = Filter.NONE,
    walk: Walking = None,
    logs: Logs = None,
    seed: Seed = 0,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Deviation of the terminal in free space under impedance control (Table 4, Fig. 16)."""
    from tdfscal.cli.controlling import Choices, run_free_space

    choices = Choices(
        calibrations=calibration or [],
        runs=runs,
        perfect=perfect,
        mounting=mounting,
        drift=drift,
        tare=tare,
        filter=filtered.value,
        walk=walk,
        logs=None if logs is None else logs.value,
        seed=seed,
        json=json,
        quiet=quiet,
    )
    run_free_space(rig, output, choices, moves)


@study.command()
def docking(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    runs: Runs = 10,
    engagement: Annotated[
        float | None, typer.Option(metavar="MM", help="Length of the engagement, default 333 mm.")
    ] = None,
    perfect: Perfect = False,
    mounting: Mounting = None,
    drift: Drift = 0.0,
    tare: Tare = False,
    filtered: Filtered = Filter.NONE,
    walk: Walking = None,
    logs: Logs = None,
    seed: Seed = 0,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Contact force and torque while the gears are docked (Figs. 17 and 18)."""
    from tdfscal.cli.controlling import Choices, run_docking

    choices = Choices(
        calibrations=calibration or [],
        runs=runs,
        perfect=perfect,
        mounting=mounting,
        drift=drift,
        tare=tare,
        filter=filtered.value,
        walk=walk,
        logs=None if logs is None else logs.value,
        seed=seed,
        json=json,
        quiet=quiet,
    )
    run_docking(rig, output, choices, engagement)
