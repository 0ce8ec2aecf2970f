"""The application, and the options that its commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tdfscal import __version__
from tdfscal.cli.words import Grouped

app = typer.Typer(
    name="tdfscal",
    cls=Grouped,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Plain help: drawing it with rich would cost half of its time.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Calibrate how three-axis force sensors are mounted on a parallel assembly mechanism.",
)


def _version(value: bool) -> None:
    if value:
        print(f"tdfscal {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    del version


Paths = Annotated[list[Path], typer.Argument(metavar="PATH", help="Campaign folder, or log files.")]
CalibrationFile = Annotated[
    Path, typer.Argument(metavar="CALIBRATION", help="Calibration file; - for stdin.")
]
Rig = Annotated[Path, typer.Argument(metavar="RIG", help="rig.yaml, or its folder.")]
RigFile = Annotated[
    Path | None, typer.Option("--rig", metavar="FILE", help="rig.yaml, where no folder holds one.")
]
_MOMENT = "12.5, 1.5min or 2h on its clock; +90 after its begin; or a date with a time."
From = Annotated[
    str | None, typer.Option("--from", metavar="T", help=f"Use the log from T on: {_MOMENT}")
]
To = Annotated[str | None, typer.Option("--to", metavar="T", help="Use the log up to T.")]
Html = Annotated[
    Path | None,
    typer.Option("--html", metavar="FILE", help="Also write a report page, whatever the verdict."),
]
Figures = Annotated[
    Path | None,
    typer.Option(
        "--figures", metavar="DIR", help="Also write the figures, each as PNG, SVG and PDF."
    ),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on standard error.")]
