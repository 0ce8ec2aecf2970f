"""A run of a command in this process: its standard streams, its progress, how it ends.

It ends with a status always, and in one line where it fails. A report may fail on standard output
unnoticed, a result may not.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, Any

from tdfscal.errors import TdfscalError, UsageError, inaccessible, is_short, shortage, visible

if TYPE_CHECKING:
    from tdfscal.commands.options import Command, Described, Progress
    from tdfscal.commands.result import Result

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70
#: Signals that end a run with all cleaning up; what the caller ignores (nohup) stays ignored.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
#: Streams that were closed before the program began.
_closed: set[str] = set()


class Interrupted(BaseException):
    """A signal, whose number it has, ends the run."""


@dataclass(slots=True)
class End:
    """Status with which the program leaves. signal : number of what came, 0 until then."""

    status: int = 0
    signal: int = 0

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        self.signal = number
        raise Interrupted(number)


@contextlib.contextmanager
def ending() -> Iterator[End]:
    """Turn whatever ends the block into a status and one line on standard error."""
    end = End()
    before = _listen(end.interrupt)
    _prepare_streams()
    try:
        yield end
        with reporting():
            pass
    except BaseException as fault:
        _listen(signal.SIG_IGN)
        # Some code between makes another exception of a signal's.
        if end.signal or isinstance(fault, KeyboardInterrupt):
            number = 128 + (end.signal or signal.SIGINT)
            end.status = ended(number, "interrupted", "interrupted; nothing was written")
        else:
            end.status = _judged(fault)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _listen(handler: Any) -> dict[int, Any]:
    """Let the signals that end a run be taken so; return by what they were taken before."""
    before = dict[int, Any]()
    with contextlib.suppress(ValueError):  # not in the main thread: its owner has the signals
        for number in (getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)):
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    return before


def _judged(fault: BaseException) -> int:
    """Say what no command foresees; return its status."""
    if os.environ.get("TDFSCAL_TRACEBACK") or isinstance(fault, SystemExit):
        raise fault
    if is_short(fault):
        return failed(shortage())
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
        raise unwritten(fault, "the result") from fault


def unwritten(fault: OSError | ValueError, what: str) -> UsageError:
    """Return the error of standard output that does not take a text; nothing more goes there."""
    leave_stdout()
    reason = getattr(fault, "strerror", None) or str(fault)
    hint = "write it to a file with room for it"
    return UsageError(f"{what} cannot be written: {reason}", where="standard output", hint=hint)


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
    """Call a command's function with its options, print its result, return its status.

    options : all of the command's; None leaves one to the function; `json`, `quiet`, `verbose`
    concern the printing.

    Raises TdfscalError by cause.
    """
    import logging

    from tdfscal.files.outputs import together
    from tdfscal.files.saving import to_json

    logging.disable(logging.WARNING)  # matplotlib has words for a home without room
    asked = {option: value for option, value in options.items() if value is not None}
    json, verbose = asked.pop("json"), asked.pop("verbose")
    files = [p for p in command.parameters if p.option.writes is not None and p.name in asked]
    carried = _carried(asked, files, json=json)
    places = [(asked[p.name], p.option.holds) for p in files if p.name in asked]
    text = ""
    # Where standard output carries the result, it is an output like any other: all or none.
    with together():
        result = _call(command, asked)
        # What the quality gate rejects is not written, unless asked for.
        written = result.exit_status == 0 or asked.get("allow_rejected", True)
        for note in result.notes:  # before the numbers that they concern, wherever these go
            say(f"tdfscal: warning: {note}")
        if json:
            hand_over(to_json(result.to_dict(), indent=1))
        elif carried and written:
            hand_over(getattr(result, carried))
        else:
            there = [str(path) for path, holds in places if written or holds == "html"]
            text = _with_places(result.shown(whole=verbose), there)
    _listen(signal.SIG_IGN)  # all is done
    with reporting():
        sys.stdout.write(text)
    if result.exit_status and "allow_rejected" in asked:
        what = "it was written as rejected" if written else "nothing was written"
        if not written and "html" in asked:
            what = "only its page was written"
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status


def _with_places(text: str, places: Sequence[str]) -> str:
    """A result in words, and what was written."""
    if not text or not places:
        return text
    *others, last = map(visible, places)
    return f"{text}\nwrote {', '.join(others)}{' and ' if others else ''}{last}\n"


def _carried(asked: dict[str, Any], files: Sequence[Described], *, json: bool) -> str | None:
    """Take the `-` of an option away; return the text that standard output gets for it."""
    carried = None
    for file in files:
        holds = file.option.holds if file.option.dash else ""
        if str(asked[file.name]) == "-":
            if not holds or (json and holds == "html"):
                what = "the JSON object" if json else "the result in words"
                where = f"{file.flags[0]} -"
                raise UsageError(f"standard output has {what}", where=where, hint="name a file")
            del asked[file.name]
            carried = holds
    return carried


def _line() -> str:
    """The command line as the user gave it."""
    return " ".join(["tdfscal", *sys.argv[1:]]).encode("utf-8", "replace").decode()


def _call(command: Command, asked: dict[str, Any]) -> Result:
    """Call its function; files stand one after the other there, as in `compare(a, b)`."""
    asked["progress"] = _on_stderr(quiet=asked.pop("quiet", False))
    several = [p.name for p in command.parameters if p.several]
    files = [path for name in several for path in asked.pop(name)]
    return command.call(_line(), *files, **asked)


def _on_stderr(*, quiet: bool) -> Progress | None:
    """Return what shows progress to a user; each line is headed by the seconds since now."""
    if quiet:
        return None
    started = time.monotonic()
    return lambda stage: say(f"[{time.monotonic() - started:5.1f} s] {stage} …")
