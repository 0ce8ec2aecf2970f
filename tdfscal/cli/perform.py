"""What every command does: call the workflow of its name, and print the result."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any

from tdfscal.cli.progress import on_stderr
from tdfscal.cli.streams import Signalled, hand_over, leave_stdout, reporting, say
from tdfscal.errors import UsageError, visible
from tdfscal.memory import check_room

if TYPE_CHECKING:
    from tdfscal.workflows.result import Result


def perform(
    name: str,
    options: dict[str, Any],
    *,
    dash: Mapping[str, str] | None = None,
) -> Result:
    """Call `tdfscal.workflows.<name>` with a command's options and print its result.

    Parameters
    ----------
    name : of the module and its function; `study.accuracy` for a study.
    options : all of the command's, by name; `json` and `quiet` concern the printing only.
    dash : options that take `-` for standard output, and the text of the result that it gets.

    Raises
    ------
    TdfscalError
        By cause.
    """
    check_room()
    from tdfscal.files.outputs import Outputs, together

    json, output = options.pop("json"), options.get("output")
    carried = _carried(options, dash or {}, json=json)
    outputs = Outputs()
    try:
        # Where standard output carries the result, it is an output like any other: all or none.
        with together(outputs):
            result = _call(name, options)
            words = not json and (carried is None or not _written(result, options))
            if json:
                hand_over(_to_json(result.to_dict()))
            elif not words and carried is not None:
                hand_over(getattr(result, carried))
        if words:
            with reporting():
                _show(result, _places(result, options, output))
        for text in result.notes:
            say(f"tdfscal: warning: {text}")
    except (KeyboardInterrupt, Signalled):
        if not outputs.appeared:
            raise
        leave_stdout()  # the files are there: only the rest of the report is cut off
    return result


def judged(result: Result, *, page: bool, written: bool) -> int:
    """Return the exit status of a calibration; say what became of one that the gate rejects."""
    if result.exit_status:
        nothing = "only its page was written" if page else "nothing was written"
        what = "it was written as rejected" if written else nothing
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status


def _show(result: Result, places: list[str]) -> None:
    """Print a result in words, and what was written."""
    if show_words(result) and places:
        *others, last = map(visible, places)
        print(f"\nwrote {', '.join(others)} and {last}" if others else f"\nwrote {last}")


def _places(result: Result, options: dict[str, Any], output: object) -> list[str]:
    """Files that a command wrote, or their folder; page and figures whatever the verdict."""
    places = []
    if output is not None and _written(result, options):
        files = getattr(result, "files", None)
        places.append(str(output) if files is None else f"{len(files)} files to {output}")
    return [*places, *(str(options[o]) for o in ("html", "figures") if options.get(o) is not None)]


def _written(result: Result, options: dict[str, Any]) -> bool:
    """Tell whether a result is written; what the quality gate rejects is not, unless asked for."""
    return result.exit_status == 0 or bool(options.get("allow_rejected", True))


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


def _to_json(document: Any) -> str:
    """One JSON object."""
    import json

    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1) + "\n"
