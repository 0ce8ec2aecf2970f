"""What every command does: call the workflow of its name, and print the result."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any

from tdfscal.cli.progress import on_stderr
from tdfscal.errors import UsageError, visible

if TYPE_CHECKING:
    from tdfscal.workflows.result import Result


def perform(
    name: str,
    options: dict[str, Any],
    *,
    dash: Mapping[str, str] | None = None,
    show: Callable[[Result], None] | None = None,
) -> Result:
    """Call `tdfscal.workflows.<name>` with a command's options and print its result.

    Parameters
    ----------
    name : of the module and its function; `study.accuracy` for a study.
    options : all of the command's, by name; `json` and `quiet` concern the printing only.
    dash : options that take `-` for standard output, and the text of the result that it gets.
    show : prints the result in words; by default its text, and where it was written.

    Raises
    ------
    TdfscalError
        By cause.
    """
    json, output = options.pop("json"), options.get("output")
    carried = _carried(options, dash or {}, json=json)
    result = _call(name, options)
    if json:
        _emit(result.to_dict())
    elif carried is not None:
        sys.stdout.write(getattr(result, carried))
    elif show is not None:
        show(result)
    elif show_words(result) and output is not None:
        files = getattr(result, "files", None)
        where = output if files is None else f"{len(files)} files to {output}"
        print(f"\nwrote {visible(str(where))}")
    for text in result.notes:
        print(f"tdfscal: warning: {visible(text)}", file=sys.stderr)
    return result


def show_words(result: Result) -> bool:
    """Print a result in words, with tables by rich on a terminal; False where it has none."""
    from tdfscal.reporting import terminal

    report = result.to_report()
    if report is None:
        return sys.stdout.write(result.text) > 0
    terminal.show(report)
    return True


def _carried(options: dict[str, Any], dash: Mapping[str, str], *, json: bool) -> str | None:
    """Take the `-` of an option away; return the text that standard output gets for it."""
    carried = None
    for option in ("output", "html"):
        if str(options.get(option)) == "-":
            if option not in dash or (json and option == "html"):
                raise UsageError(
                    f"--{option} - and the result both want standard output", hint="name a file"
                )
            options[option] = None
            carried = dash[option]
    return carried


def _call(name: str, options: dict[str, Any]) -> Result:
    function: Callable[..., Result] = getattr(
        import_module(f"tdfscal.workflows.{name}"), name.rpartition(".")[2]
    )
    parameters = signature(function).parameters
    if "command" in parameters:
        options["command"] = command_line()
    options["progress"] = on_stderr(quiet=options.pop("quiet", False))
    # Files named one after the other, as `compare(a, b)` takes them.
    several = next((k for k, p in parameters.items() if p.kind is Parameter.VAR_POSITIONAL), None)
    files = options.pop(several) if several is not None else ()
    return function(*files, **options)


def command_line() -> str:
    """Return the command as the user gave it."""
    return " ".join(["tdfscal", *sys.argv[1:]]).encode("utf-8", "replace").decode()


def _emit(document: Any) -> None:
    """Print one JSON object."""
    import json

    print(json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1))
