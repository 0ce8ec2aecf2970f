"""Options that several commands share, each with its help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
Trials = Annotated[
    int | None, typer.Option("--trials", min=0, help="Monte Carlo trials at most; 0 for none.")
]
AllowRejected = Annotated[
    bool, typer.Option("--allow-rejected", help="Write the file even if the gate rejects it.")
]
Salvage = Annotated[
    bool, typer.Option("--salvage", help="Read what is sound of a damaged log; never accepted.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on standard error.")]
