"""A run of a command in this process: its standard streams, its progress, how it ends.

It ends with a status always, and in one line where it fails. A report may fail on standard output
unnoticed, a result may not.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from inspect import signature
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdfscal import memory
from tdfscal.cli.interruption import Signalled, current
from tdfscal.errors import TdfscalError, UsageError, inaccessible, visible

if TYPE_CHECKING:
    from tdfscal.commands.arguments import Progress
    from tdfscal.commands.options import Command
    from tdfscal.commands.result import Result
    from tdfscal.reporting.layout import Report

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70
#: Streams that were closed before the program began.
_closed: set[str] = set()


@dataclass(slots=True)
class End:
    """Status with which the program leaves."""

    status: int = 0


@contextlib.contextmanager
def ending() -> Iterator[End]:
    """Turn whatever ends the block into a status and one line on standard error."""
    end, interruption = End(), current.get()
    _prepare_streams()
    try:
        yield end
        with reporting():
            pass
    except BaseException as fault:
        # Some code between makes another exception of a signal's.
        if interruption.number is not None or isinstance(fault, KeyboardInterrupt):
            number = 128 + (interruption.number or 2)
            end.status = ended(number, "interrupted", "interrupted; nothing was written")
        else:
            end.status = _judged(fault)
    finally:
        interruption.end()


def _judged(fault: BaseException) -> int:
    """Say what no command foresees; return its status."""
    if os.environ.get("TDFSCAL_TRACEBACK") or isinstance(fault, SystemExit):
        raise fault
    if memory.is_short(fault):
        return failed(memory.shortage())
    if isinstance(fault, OSError):
        return failed(inaccessible(fault))
    said = " ".join(str(fault).split())
    return ended(
        INTERNAL_ERROR,
        "internal-error",
        f"internal error, {type(fault).__name__}: {said}. This is a fault of "
        "tdfscal, not of your data; run again with TDFSCAL_TRACEBACK=1 and report the output.",
    )


def failed(error: TdfscalError) -> int:
    """Say what is wrong; return its status."""
    return ended(error.exit_status, error.finding.code, str(error), error.where)


def ended(status: int, code: str, message: str, where: str | None = None) -> int:
    """Say how a run failed, with `--json` as a last line that programs read; return its status."""
    say(f"tdfscal: {message}")
    if "--json" in sys.argv:
        import json

        error = {"code": code, "status": status, "message": message, "where": where}
        say(json.dumps({"error": error}))
    return status


def _prepare_streams() -> None:
    """Let standard streams replace letters that their encoding lacks.

    A stream that is closed becomes /dev/null, lest a file that is opened later takes its number.
    """
    _closed.clear()
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream: Any = getattr(sys, name)
        if stream is None:
            _closed.add(name)
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115, PTH123
        elif name == "stdout" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def hand_over(text: str) -> None:
    """Write a result to standard output, as UTF-8. Raises UsageError where that fails."""
    try:
        if "stdout" in _closed:
            raise OSError(errno.EBADF, "it is closed")
        buffer = getattr(sys.stdout, "buffer", None)
        sys.stdout.flush()
        if buffer is None:
            sys.stdout.write(text)
        else:
            buffer.write(text.encode("utf-8", "surrogateescape"))
        sys.stdout.flush()
    except (OSError, ValueError) as fault:
        leave_stdout()
        reason = getattr(fault, "strerror", None) or str(fault)
        raise UsageError(
            f"the result cannot be written: {reason}",
            where="standard output",
            hint="write it to a file with room for it",
        ) from fault


@contextlib.contextmanager
def reporting() -> Iterator[None]:
    """Report on standard output; that it is full, or that nobody listens, changes nothing."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        leave_stdout()
    except (OSError, ValueError) as fault:
        leave_stdout()
        reason = getattr(fault, "strerror", None) or str(fault)
        say(f"tdfscal: warning: standard output takes no more of the report: {reason}")


def say(text: str) -> None:
    """Write to standard error, where there is somebody to read it; line by line, all visible."""
    with contextlib.suppress(OSError, ValueError):
        print("\n".join(map(visible, text.split("\n"))), file=sys.stderr, flush=True)


def leave_stdout() -> None:
    """Write nothing more to standard output, not even at the end of the program."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


def perform(command: Command, options: Mapping[str, Any]) -> int:
    """Call a command's function with its options and print its result.

    options : all of the command's; None leaves one to the function; `json`, `quiet`, `verbose`
    concern the printing.

    Raises TdfscalError by cause.
    """
    import logging

    from tdfscal.files.outputs import together
    from tdfscal.files.saving import to_json

    logging.disable(logging.WARNING)  # matplotlib has words for a home without room

    asked = {option: value for option, value in options.items() if value is not None}
    json, verbose = asked.pop("json"), asked.pop("verbose", False)
    carried = _carried(asked, command.carries, json=json)
    places = [
        (p, Path(asked[p.name]))
        for p in command.parameters
        if p.option.writes is not None and p.name in asked
    ]
    before, outputs = _dates(path for _, path in places), None
    try:
        # Where standard output carries the result, it is an output like any other: all or none.
        with together(current.get().held) as outputs:
            result = _call(command.function, asked)
            # What the quality gate rejects is not written, unless asked for.
            written = result.exit_status == 0 or asked.get("allow_rejected", True)
            words = not json and (carried is None or not written)
            report = result.to_report()
            # Before the numbers that they concern, and wherever these go.
            for note in dict.fromkeys((*result.notes, *(report.warnings if report else ()))):
                say(f"tdfscal: warning: {note}")
            if json:
                hand_over(to_json(result.to_dict(), indent=1))
            elif not words and carried is not None:
                hand_over(getattr(result, carried))
        if words:
            # Made before: of what goes wrong here, only the writing is forgiven.
            there = [str(path) for p, path in places if written or p.option.holds == "html"]
            text = _in_words(result, report, there, whole=verbose)
            with reporting():
                sys.stdout.write(text)
        current.get().end()  # all is done
    except (KeyboardInterrupt, Signalled):
        if outputs is None or not outputs.appeared:
            raise
        current.get().end()
        leave_stdout()  # the files are there: only the rest of the report is cut off
    except TdfscalError as error:
        left = _left(before) if error.exit_status > UsageError.exit_status else ""
        if not left:
            raise
        hint = "; ".join(filter(None, (error.hint, left)))
        raise error.restated(hint=hint) from error
    if result.exit_status and "allow_rejected" in asked:
        nothing = "only its page was written" if "html" in asked else "nothing was written"
        what = "it was written as rejected" if written else nothing
        what = "; ".join(filter(None, (what, _left(before))))
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status


def _dates(paths: Iterable[Path]) -> dict[Path, float]:
    """When those that are files were last written, s since 1970."""
    found = {}
    for path in paths:
        with contextlib.suppress(OSError):  # of a name that is too long
            if path.is_file():
                found[path] = path.stat().st_mtime
    return found


def _left(before: Mapping[Path, float]) -> str:
    """Name the files that a run without a result leaves in the places of its own."""
    now = _dates(before)
    left = [
        f"{path} of an earlier run ({datetime.fromtimestamp(when, UTC):%Y-%m-%d %H:%M} UTC)"
        for path, when in before.items()
        if now.get(path) == when
    ]
    return f"left as it was: {', '.join(left)}" if left else ""


def _in_words(result: Result, report: Report | None, places: list[str], *, whole: bool) -> str:
    """Return a result in words, in colours for a terminal, and what was written."""
    from tdfscal.reporting.text import shown

    said = report
    # Standard error has had them; a numbered report, printed whole, stands for itself.
    if report is not None and (not report.number or (report.summary and not whole)):
        said = replace(report, warnings=())
    text = result.text if said is None else shown(said, whole=whole)
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


def _on_stderr(*, quiet: bool) -> Progress:
    """Return what shows progress to a user; each line is headed by the seconds since now."""
    from tdfscal.commands.arguments import SILENT, Progress

    if quiet:
        return SILENT
    started = time.monotonic()

    def tell(stage: str) -> None:
        say(f"[{time.monotonic() - started:5.1f} s] {stage} …")

    return Progress(stage=tell, reading=_reading_bar)


@contextlib.contextmanager
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
