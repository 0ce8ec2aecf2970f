"""`tdfscal plan`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import PLAN

Objective = Literal["angles", "wrench"]


@command(PLAN, "plan rig.yaml -o plan.csv --postures 24")
def plan(
    rig: options.Rig,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE.csv", help="Postures, or the time table, to drive."
        ),
    ],
    postures: Annotated[
        int | None, typer.Option(min=1, help="Postures to drive, returns included; default 24.")
    ] = None,
    target: Annotated[
        float | None,
        typer.Option(metavar="MRAD", help="As many postures as bring every angle within this."),
    ] = None,
    tilt: Annotated[float, typer.Option(metavar="DEG", help="Largest tilt, degrees.")] = 5.0,
    squeeze: Annotated[
        float, typer.Option(metavar="N", help="Largest internal force at any NCP, N.")
    ] = 200.0,
    force_limit: Annotated[
        float | None, typer.Option(metavar="N", help="Largest force at any NCP in all, N.")
    ] = None,
    travel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NCP=]M[,M,M]", help="Way from home, either side, m: of all NCPs, or of one."
        ),
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="LCS origin in the BCS at home, m; default 0,0,0."),
    ] = None,
    stiffness: Annotated[
        float | None,
        typer.Option(
            metavar="N/M", help="Of an NCP: squeeze by displacements; else by servoed forces."
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Noise of a posture's mean force per axis, N; default 1, or that of --given; of a "
            "motion, of a mean over a second, default 0.1.",
        ),
    ] = None,
    candidates: Annotated[int, typer.Option(min=1, help="Postures to choose from.")] = 1000,
    objective: Annotated[
        Objective,
        typer.Option(case_sensitive=False, help="The quantity whose uncertainty is minimised."),
    ] = "angles",
    at: Annotated[
        str | None,
        typer.Option(metavar="R,P,Y", help="Assembly posture for the contact wrench, rad."),
    ] = None,
    given: Annotated[
        list[Path] | None,
        typer.Option(metavar="PATH", help="Campaign or log recorded already; plan what is next."),
    ] = None,
    motion: Annotated[
        bool, typer.Option("--motion", help="Plan a motion without a stop, not postures.")
    ] = False,
    duration: Annotated[float, typer.Option(metavar="S", help="Of the motion, s.")] = 60.0,
    speed: Annotated[
        float, typer.Option(metavar="M/S", help="Largest speed of a hinge in motion, m/s.")
    ] = 0.02,
    waypoints: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Also write the motion's waypoints for a spline."),
    ] = None,
    figures: options.Figures = None,
    seed: options.Seed = 0,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Choose the postures and squeezes, or the motion, to drive, and say what to expect of them."""
    asked = locals()
    asked |= {"travel": travel or (), "given": given or ()}
    return perform("plan", asked, dash={"output": "content"}).exit_status
