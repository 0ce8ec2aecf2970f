"""`tdfscal plan`: options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import Json, Seed, app


class Objective(StrEnum):
    """What a plan makes certain."""

    ANGLES = "angles"
    WRENCH = "wrench"


@app.command()
def plan(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="rig.yaml, or its folder.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.csv", help="Postures to drive.")
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
            help="Noise of a posture's mean force per axis, N; default 1, or that of --given.",
        ),
    ] = None,
    candidates: Annotated[int, typer.Option(min=1, help="Postures to choose from.")] = 1000,
    objective: Annotated[
        Objective, typer.Option(help="Make the angles certain, or the contact wrench.")
    ] = Objective.ANGLES,
    at: Annotated[
        str | None,
        typer.Option(metavar="R,P,Y", help="Assembly posture for the contact wrench, rad."),
    ] = None,
    given: Annotated[
        list[Path] | None,
        typer.Option(metavar="PATH", help="Campaign or log recorded already; plan what is next."),
    ] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Choose the postures and squeezes to drive, and say what to expect of them."""
    from tdfscal.cli.planning import run

    run(
        rig,
        output=output,
        postures=postures,
        target=target,
        tilt=tilt,
        squeeze=squeeze,
        force_limit=force_limit,
        travel=travel or [],
        home=home,
        stiffness=stiffness,
        noise=noise,
        candidates=candidates,
        objective=objective.value,
        at=at,
        given=given or [],
        seed=seed,
        json=json,
    )
