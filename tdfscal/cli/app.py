"""The application, and what makes a command of it."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import Parameter, Signature
from typing import Annotated, Any

import typer

from tdfscal import __version__
from tdfscal.cli.options import Option
from tdfscal.cli.perform import perform
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


def command(
    purpose: str | None,
    example: str,
    text: str,
    dash: Mapping[str, str] | None = None,
    /,
    **options: Option,
) -> None:
    """Make a command that calls the workflow of its name with its options.

    purpose : its heading in the help. example : a command line, which begins with its name.
    text : what it does, in one sentence. dash : options that take `-` for standard output, and
    the text of the result that it gets. options : in the order of the help.
    """
    name = example.split()[0]

    def call(**asked: Any) -> int:
        return perform(name, asked, dash or {})

    call.__doc__ = text
    parameters = [
        Parameter(each, Parameter.KEYWORD_ONLY, annotation=kind, default=described)
        for each, (kind, described) in options.items()
    ]
    call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    app.command(name, rich_help_panel=purpose, epilog=f"Example: tdfscal {example}")(call)
