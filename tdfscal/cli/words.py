"""What the command line says of itself: purposes, and mistakes in one paragraph."""

from __future__ import annotations

import re
from typing import Any

import typer

#: Purposes of commands, in the order of the help.
PURPOSES = CALIBRATE, CHECK, USE, PLAN = "Calibrate", "Check", "Put to work", "Plan and try"
#: What pydantic-like messages of the option parser mean, in words.
_PLAIN = (
    (r"Input should be a valid integer.*", "this is no whole number"),
    (r"Input should be a valid number.*", "this is no number"),
    (r"Input should be (.*)", r"it must be \1"),
    (r"Value error, ", ""),
    (r"^Missing argument '([^']*)'", r"\1 is missing"),
    (r"^Missing option (.*)", r"the option \1 is missing"),
    (r"^Option '([^']*)' requires an argument", r"\1: its value is missing"),
    (r"^(No such command '[^']*')\. Did you mean '([^']*)'.*", r"\1 (did you mean \2?)"),
    (r"^No such option: ", "there is no option "),
    (r"^No such command ", "there is no command "),
    (r" \(Possible options: .*", ""),
)


def mistake(error: Any) -> str:
    """Say what is wrong with a command line, in one paragraph; the help where it is bare."""
    said = str(error.format_message())
    if said.startswith("Usage:"):
        return f"no command is given\n\n{said}"
    said = " ".join(said.split()).rstrip(".")
    for pattern, plain in _PLAIN:
        said = re.sub(pattern, plain, said)
    if near := getattr(error, "possibilities", None):  # the nearest option first
        said = f"{said} (did you mean {near[0]}?)"
    context = getattr(error, "ctx", None)
    path = getattr(context, "command_path", "tdfscal")
    epilog = getattr(getattr(context, "command", None), "epilog", None) or ""
    shown = f" {epilog.rstrip('.')}." if "is missing" in said and epilog else ""
    return f"{said}.{shown} '{path} --help' lists what it takes."


def misuse() -> type[Exception]:
    """Return what typer raises for a faulty command line, whichever click it carries."""
    return typer.BadParameter.__bases__[0]
