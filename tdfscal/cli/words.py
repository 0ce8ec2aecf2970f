"""What the command line says of itself: commands grouped by purpose, mistakes in one paragraph."""

from __future__ import annotations

import re
from typing import Any

import typer
from typer.core import TyperGroup

#: Purposes in the order of the help; a command names its own as `rich_help_panel`.
_PURPOSES = CALIBRATE, CHECK, USE, PLAN = "Calibrate", "Check", "Put to work", "Plan and try"
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


class Grouped(TyperGroup):
    """Commands by purpose, each with its whole first sentence."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section per purpose."""
        rows: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                first = (command.help or "").partition("\n")[0]
                rows.setdefault(str(command.rich_help_panel), []).append((name, first))
        widest = max(len(name) for found in rows.values() for name, _ in found)
        with formatter.section("Commands"):
            for purpose in (p for p in _PURPOSES if p in rows):
                listed = [(name.ljust(widest), first) for name, first in rows.pop(purpose)]
                with formatter.section(purpose):
                    formatter.write_dl(listed)
            for others in rows.values():
                formatter.write_dl(others)


def plainly_typed(command: Any) -> None:
    """Let the help of a command, and of those in it, show no types of Python: `<list[Path]>`."""
    for inner in getattr(command, "commands", {}).values():
        plainly_typed(inner)
    for param in command.params:
        if param.param_type_name == "argument":
            param.display_type_rich = lambda ctx: None
        elif param.metavar is None and not param.is_flag and not param.type_descriptor.is_choice:
            param.display_type_rich = lambda ctx: "N"


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
