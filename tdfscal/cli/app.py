"""The command line, made of the commands' signatures; a command is loaded when it is asked for."""

from __future__ import annotations

import os
import sys
import warnings
from functools import cache
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_origin

import typer
import typer.core
import typer.main

from tdfscal import __version__
from tdfscal.cli.process import ended, failed, leave_stdout, perform, unwritten
from tdfscal.errors import UsageError, without_tails

if TYPE_CHECKING:
    from tdfscal.commands.options import Command, Described

#: Commands by purpose, in the order of the help.
PURPOSES = {
    "Calibrate": ("calibrate", "info", "init", "register", "report", "update"),
    "Check": ("compare", "monitor", "validate"),
    "Put to work": ("apply", "capability", "export"),
    "Plan and try": ("plan", "simulate"),
}
COMMANDS = tuple(sorted(name for names in PURPOSES.values() for name in names))
#: What the printing takes, of every command.
PRINTED = {
    "json": typer.Option(False, "--json", help="Print one JSON object and nothing else."),
    "quiet": typer.Option(False, "--quiet", "-q", help="No progress on standard error."),
    "verbose": typer.Option(
        False, "--verbose", "-v", help="Print the whole report where there is a summary."
    ),
}
_HELP = {"help_option_names": ["-h", "--help"]}
#: What typer raises for a faulty command line, whichever click it carries.
_MISUSE: type[Exception] = typer.BadParameter.__bases__[0]


#: What typer makes of an interruption.
_INTERRUPTED = 130


class Commands(typer.core.TyperGroup):
    """The commands by purpose, each loaded at its first use."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands: Any = dict.fromkeys(COMMANDS)  # from which a name near by is suggested

    def list_commands(self, ctx: Any) -> list[str]:
        """Return their names."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return one, or None."""
        return made(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section per purpose, each command with its whole first sentence."""
        widest = max(map(len, COMMANDS))
        with formatter.section("Commands"):
            for purpose, names in PURPOSES.items():
                rows = [(name.ljust(widest), summary(name)) for name in names]
                with formatter.section(purpose):
                    formatter.write_dl(rows)


app = typer.Typer(
    name="tdfscal",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Plain help: drawing it with rich would cost half of its time.
    rich_markup_mode=None,
    context_settings=_HELP,
    help="Calibrate how three-axis force sensors are mounted on a parallel assembly mechanism.",
)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"tdfscal {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    del version


def summary(name: str) -> str:
    """Return what a command does: its function's first sentence, without loading it."""
    text = Path(__file__).parents[1].joinpath("commands", f"{name}.py").read_text(encoding="utf-8")
    return text.partition(f"\ndef {name}(")[2].partition('"""')[2].partition("\n")[0].strip('"')


def described(name: str) -> Command:
    """Return a command with what its function says of itself."""
    import_module(f"tdfscal.commands.{name}")
    from tdfscal.commands.options import COMMANDS as LOADED

    return LOADED[name]


@cache
def made(name: str) -> Any:
    """Make a command of the function of its name."""
    command = described(name)

    def call(**asked: Any) -> int:
        return perform(command, asked)

    call.__doc__ = summary(name)
    parameters = [_parameter(each) for each in command.parameters]
    parameters += [
        Parameter(each, Parameter.KEYWORD_ONLY, annotation=bool, default=option)
        for each, option in PRINTED.items()
    ]
    call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    epilog = f"Example: tdfscal {command.example}"
    alone.command(name, epilog=epilog, context_settings=_HELP)(call)
    result: Any = typer.main.get_command(alone)
    result.name = name
    for param in result.params:
        if param.param_type_name == "argument":  # no `<list[Path]>`
            param.display_type_rich = lambda ctx: None
    return result


def _parameter(one: Described) -> Parameter:
    """Return a parameter as typer wants it."""
    default, kind = None if one.default == () else one.default, one.kind
    told: Any
    if one.positional:
        told = typer.Argument(default, metavar=one.metavar, help=one.sentence)
    else:
        kind = kind | None if default is None and get_origin(kind) is list else kind
        told = typer.Option(
            default,
            *one.names,
            metavar=one.metavar or (None if one.words or kind is bool else "N"),
            help=one.sentence,
            case_sensitive=not one.words,
            show_default=not isinstance(default, Path),
        )
    return Parameter(one.name, Parameter.KEYWORD_ONLY, annotation=kind, default=told)


def run() -> int:
    """Run the command that the command line asks for; return the exit status."""
    # A command's module loads the libraries. More threads of linear algebra wait for each other,
    # and numbers would follow the machine.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if not sys.warnoptions:  # what concerns a user is in the result
        warnings.simplefilter("ignore")
    try:
        if "" in sys.argv[1:]:  # as a path it would be the folder of now
            raise UsageError(
                "an argument is empty",
                hint="name the file or folder; a variable of the shell may not be set",
            )
        status = typer.main.get_command(app)(standalone_mode=False, prog_name="tdfscal") or 0
    except _MISUSE as error:
        return ended(2, UsageError.code, _mistake(error))
    except SystemExit as end:
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        leave_stdout()  # nobody reads the help
        return 0
    except OSError as fault:  # of a command they are errors of ours
        return failed(unwritten(fault, "the help"))
    if status == _INTERRUPTED:
        raise KeyboardInterrupt
    return int(status)


def _mistake(error: Any) -> str:
    """Say what is wrong with a command line, in one paragraph; the help where it is bare."""
    said = str(error.format_message())
    if said.startswith("Usage:"):
        return f"no command is given\n\n{said}"
    said = " ".join(said.replace("Value error, ", "").split()).rstrip(".?")
    # An option without its value is found before there is a context.
    named = [word for word in sys.argv[1:2] if word in COMMANDS]
    path = getattr(getattr(error, "ctx", None), "command_path", " ".join(["tdfscal", *named]))
    example = getattr(getattr(getattr(error, "ctx", None), "command", None), "epilog", None)
    shown = f" {example}." if example and "Missing" in said else ""
    return f"{without_tails(said)}.{shown} '{path} --help' lists what it takes."
