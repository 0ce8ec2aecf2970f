"""`tdfscal simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import PLAN

#: As the simulation has them, which the help does not import; a test compares.
SCENARIOS = (
    *("self", "tracker", "months", "motion", "approach", "stops"),
    *("contact", "crosstalk", "dead-axis", "drift", "gain", "jolt", "no-squeeze", "saturation"),
    *("soft-supports", "swapped", "turned-frame", "walk", "warming", "zero-shift"),
    *("dead-channel", "load-cells"),
)
LogFormat = Literal["csv", "parquet", "mcap"]


@command(PLAN, "simulate campaign --scenario contact")
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Campaign folder to write.")],
    rig: options.RigFile = None,
    scenario: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            autocompletion=lambda: list(SCENARIOS),
            help=f"{', '.join(SCENARIOS[:6])}; or with a fault: {', '.join(SCENARIOS[6:])}.",
        ),
    ] = "self",
    format: Annotated[
        LogFormat, typer.Option(case_sensitive=False, help="Format of the log.")
    ] = "csv",
    postures: Annotated[int, typer.Option(min=1, help="Number of postures.")] = 24,
    tilt: Annotated[float, typer.Option(help="Largest tilt, degrees.")] = 5.0,
    squeeze: Annotated[float, typer.Option(help="Commanded internal forces, N.")] = 200.0,
    rate: Annotated[
        float, typer.Option(min=10.0, max=20e3, help="Samples per second of all signals.")
    ] = 100.0,
    months: Annotated[int, typer.Option(min=1, help="Campaigns of the scenario months.")] = 12,
    seed: options.Seed = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace what is in the folder.")] = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Write a synthetic campaign with its truth.yaml."""
    return perform("simulate", locals()).exit_status
