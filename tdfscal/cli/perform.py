"""What every command does: call the function of its name, show progress, print the result."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from inspect import signature
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdfscal.cli.process import Signalled, hand_over, leave_stdout, reporting, say
from tdfscal.errors import UsageError, visible
from tdfscal.memory import limit_threads

if TYPE_CHECKING:
    from tdfscal.commands.arguments import Progress
    from tdfscal.commands.options import Command
    from tdfscal.commands.result import Result


def perform(command: Command, options: Mapping[str, Any]) -> int:
    """Call a command's function with its options and print its result.

    options : all of the command's; None leaves one to the function; `json`, `quiet`, `verbose`
    concern the printing.

    Raises TdfscalError by cause.
    """
    limit_threads()
    from tdfscal.files.outputs import together

    asked = {option: value for option, value in options.items() if value is not None}
    json, verbose = asked.pop("json"), asked.pop("verbose", False)
    carried = _carried(asked, command.carries, json=json)
    outputs = None
    try:
        # Where standard output carries the result, it is an output like any other: all or none.
        with together() as outputs:
            result = _call(command.function, asked)
            # What the quality gate rejects is not written, unless asked for.
            written = result.exit_status == 0 or asked.get("allow_rejected", True)
            words = not json and (carried is None or not written)
            for note in result.notes:  # before the numbers that they concern
                say(f"tdfscal: warning: {note}")
            if json:
                hand_over(_to_json(result.to_dict()))
            elif not words and carried is not None:
                hand_over(getattr(result, carried))
        if words:
            # Made before: of what goes wrong here, only the writing is forgiven.
            places = [
                str(asked[p.name])
                for p in command.parameters
                if p.option.writes is not None
                and p.name in asked
                and (written or p.option.holds == "html")
            ]
            text = _in_words(result, places, whole=verbose)
            with reporting():
                sys.stdout.write(text)
    except (KeyboardInterrupt, Signalled):
        if outputs is None or not outputs.appeared:
            raise
        leave_stdout()  # the files are there: only the rest of the report is cut off
    for detail in result.details if verbose else ():
        say(detail)
    if result.exit_status and "allow_rejected" in asked:
        nothing = "only its page was written" if "html" in asked else "nothing was written"
        what = "it was written as rejected" if written else nothing
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status


def _in_words(result: Result, places: list[str], *, whole: bool) -> str:
    """Return a result in words, in colours for a terminal, and what was written."""
    from tdfscal.reporting.text import shown

    report = result.to_report()
    text = result.text if report is None else shown(report, whole=whole)
    if not text or not places:
        return text
    *others, last = map(visible, places)
    files = f"{', '.join(others)} and {last}" if others else last
    return f"{text}\nwrote {files}\n"


def _carried(asked: dict[str, Any], dash: Mapping[str, str], *, json: bool) -> str | None:
    """Take the `-` of an option away; return the text that standard output gets for it."""
    carried = None
    for option in ("output", "html"):
        if str(asked.get(option)) == "-":
            if option not in dash or (json and option == "html"):
                raise UsageError(
                    f"--{option} - and the result both want standard output", hint="name a file"
                )
            del asked[option]
            carried = dash[option]
    return carried


def _call(function: Callable[..., Result], asked: dict[str, Any]) -> Result:
    parameters = signature(function).parameters
    if "command" in parameters:  # as the user gave it
        line = " ".join(["tdfscal", *sys.argv[1:]])
        asked["command"] = line.encode("utf-8", "replace").decode()
    asked["progress"] = _on_stderr(quiet=asked.pop("quiet", False))
    # Files named one after the other, as `compare(a, b)` takes them.
    named = {key: asked.pop(key) for key, p in parameters.items() if p.kind is p.VAR_POSITIONAL}
    return function(*chain(*named.values()), **asked)


def _to_json(document: Any) -> str:
    """One JSON object."""
    import json

    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _on_stderr(*, quiet: bool) -> Progress:
    """Return what shows progress to a user; each line is headed by the seconds since now."""
    from tdfscal.commands.arguments import SILENT, Progress

    if quiet:
        return SILENT
    started = time.monotonic()

    def tell(text: str) -> None:
        say(f"[{time.monotonic() - started:5.1f} s] {text}")

    return Progress(stage=lambda stage: tell(f"{stage} …"), count=tell, reading=_reading_bar)


@contextmanager
def _reading_bar(paths: Sequence[Path]) -> Iterator[Callable[[float], None] | None]:
    """Give what takes the share of the files that is read; None where nobody looks."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn
    from rich.progress import TransferSpeedColumn as SpeedColumn

    size = sum(path.stat().st_size for path in paths if path.is_file())
    with Progress(
        "reading",
        BarColumn(),
        DownloadColumn(),
        SpeedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task("reading", total=size)
        yield lambda share: bar.update(task, completed=share * size)
