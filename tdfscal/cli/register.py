"""`tdfscal register`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CALIBRATE

Match = Literal["name", "point", "order"]


@command(CALIBRATE, "register measured.csv drawing.csv --unit mm")
def register(
    measured: Annotated[Path, typer.Argument(metavar="MEASURED", help="Point file, as measured.")],
    reference: Annotated[
        Path, typer.Argument(metavar="REFERENCE", help="Point file, fitted onto it.")
    ],
    unit: Annotated[
        str | None, typer.Option("--unit", metavar="U", help="Of files that name none: m, mm, in …")
    ] = None,
    match: Annotated[
        Match,
        typer.Option(
            case_sensitive=False,
            help="Pair points by group and name, by name in whatever group, or row by row.",
        ),
    ] = "name",
    groups: Annotated[
        list[str] | None,
        typer.Option(metavar="A=B", help="Measured group A is reference group B; repeatable."),
    ] = None,
    range: Annotated[
        float | None,
        typer.Option(metavar="M", help="Instrument: standard uncertainty of its range, m."),
    ] = None,
    range_ppm: Annotated[
        float | None,
        typer.Option(metavar="P", help="Instrument: what adds to it, ppm of the distance."),
    ] = None,
    angle_arcsec: Annotated[
        float | None,
        typer.Option(metavar="A", help="Instrument: standard uncertainty of its angles, arcsec."),
    ] = None,
    scale: Annotated[
        bool, typer.Option("--scale", help="Estimate a scale of the reference too.")
    ] = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Fit the rigid transform from reference points to measured ones, with its uncertainty."""
    asked = locals()
    asked["groups"] = groups or ()
    return perform("register", asked).exit_status
