"""The application, and what makes a command of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

import typer

from tdfscal import __version__
from tdfscal.cli.words import Grouped, example

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


_Command = TypeVar("_Command", bound=Callable[..., int])


def command(purpose: str, line: str) -> Callable[[_Command], _Command]:
    """Make a command of a function; purpose : its heading in the help. line : an example of it."""
    return app.command(rich_help_panel=purpose, epilog=example(f"tdfscal {line}"))
