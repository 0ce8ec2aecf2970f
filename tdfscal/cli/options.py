"""Kinds of options, and those that several commands share, each with its help."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import typer

#: The type of an option, and what typer is told of it; one whose default is `...` must be given.
Option = tuple[Any, Any]
Options = dict[str, Option]

LOG_FORMATS = Literal["csv", "parquet", "mcap"]


def argument(kind: Any, metavar: str, help: str, default: Any = ...) -> Option:
    """Return what stands without a name on the command line."""
    return kind, typer.Argument(default, metavar=metavar, help=help)


def option(kind: Any, default: Any, help: str, *names: str, **more: Any) -> Option:
    """Return an option of any kind; names : where they are not those of its parameter."""
    return kind, typer.Option(default, *names, help=help, **more)


def flag(name: str, help: str, *names: str) -> Option:
    """Return what is on where it is named."""
    return option(bool, False, help, name, *names)


def number(default: float | None, metavar: str | None, help: str, **more: Any) -> Option:
    """Return a number."""
    return option(float | None, default, help, metavar=metavar, **more)


def count(default: int | None, help: str, least: int = 1) -> Option:
    """Return a whole number."""
    return option(int | None, default, help, min=least)


def text(metavar: str, help: str, default: str | None = None) -> Option:
    """Return an option of any text."""
    return option(str | None, default, help, metavar=metavar)


def texts(metavar: str, help: str) -> Option:
    """Return an option that may be repeated."""
    return option(list[str] | None, None, help, metavar=metavar)


def choice(kind: Any, default: Any, help: str, *names: str) -> Option:
    """Return an option of a few words; kind : a Literal of them."""
    return option(kind, default, help, *names, case_sensitive=False)


def file(help: str, metavar: str = "FILE") -> Option:
    """Return an option that names a file."""
    return option(Path | None, None, help, metavar=metavar)


def output(help: str, default: Any = ..., metavar: str = "FILE", **more: Any) -> Option:
    """Return the file, or the folder, that a command writes."""
    return option(Path, default, help, "--output", "-o", metavar=metavar, **more)


PATHS = argument(list[Path], "PATH", "Campaign folder, or log files.")
CALIBRATION = argument(Path, "CALIBRATION", "Calibration file; - for stdin.")
RIG = argument(Path, "RIG", "rig.yaml, or its folder.")
RIG_FILE = file("rig.yaml, where no folder holds one.")
_MOMENT = "12.5, 1.5min or 2h on its clock; +90 after its begin; or a date with a time."
PART: Options = {
    "from_": option(str | None, None, f"Use the log from T on: {_MOMENT}", "--from", metavar="T"),
    "to": text("T", "Use the log up to T."),
}
HTML = file("Also write a report page, whatever the verdict.")
FIGURES = file("Also write the figures, each as PNG, SVG and PDF.", "DIR")
TRIALS = count(None, "Monte Carlo trials at most; 0 for none.", 0)
ALLOW_REJECTED = flag("--allow-rejected", "Write the file even if the gate rejects it.")
SALVAGE = flag("--salvage", "Read what is sound of a damaged log; never accepted.")
SEED = option(int, 0, "Seed of all random numbers.", min=0)
JSON = flag("--json", "Print one JSON object and nothing else.")
PRINTED: Options = {"json": JSON, "quiet": flag("--quiet", "No progress on standard error.", "-q")}
