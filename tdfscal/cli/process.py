"""A run of a command in this process: its standard streams, its progress, how it ends.

It ends with a status always, and in one line where it fails. A report may fail on standard output
unnoticed, a result may not.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import os
import shlex
import signal
import sys
import time
from collections.abc import Mapping
from types import FrameType
from typing import TYPE_CHECKING, Any

from tdfscal.errors import TdfscalError, UsageError, inaccessible, is_short, shortage, visible

if TYPE_CHECKING:
    from tdfscal.commands.options import Command

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70
#: Signals that end a run with all cleaning up; what the caller ignores (nohup) stays ignored.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
#: Streams that were closed before the program began.
_closed: set[str] = set()


class Interrupted(BaseException):
    """A signal ends the run."""


def status() -> int:
    """Run the command line; whatever ends it becomes a status and one line on standard error."""
    came = list[int]()

    def interrupt(number: int, frame: FrameType | None) -> None:
        came.append(number)
        raise Interrupted

    before = _listen(interrupt)
    _prepare_streams()
    try:
        from tdfscal.cli.app import run

        found = run()
        report("")
        return found
    except BaseException as fault:
        _listen(signal.SIG_IGN)
        # Some code between makes another exception of a signal's.
        if not came and not isinstance(fault, KeyboardInterrupt):
            return _judged(fault)
        number = came[0] if came else signal.SIGINT
        return ended(128 + number, "interrupted", "interrupted; nothing was written")
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
    """Say what is wrong; return its status."""
    # What else an error says of too little memory was judged without a look at that.
    if is_short(fault):
        return failed(shortage())
    if isinstance(fault, TdfscalError):
        return failed(fault)
    if os.environ.get("TDFSCAL_TRACEBACK") or isinstance(fault, SystemExit):
        raise fault
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
    """Say how a run failed; standard output has the object that `--json` promises."""
    say(f"tdfscal: {message}")
    if "--json" in sys.argv:
        import json

        error = {"code": code, "message": message, "where": where}
        told = {"command": _asked(), "status": status, "error": error}
        report(f"{json.dumps(told, indent=1)}\n")
    return status


def _asked() -> str:
    """The command line, as it can be pasted."""
    return shlex.join(["tdfscal", *sys.argv[1:]]).encode("utf-8", "replace").decode()


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
        elif name != "stdin" and hasattr(stream, "reconfigure"):
            codecs.register_error("plain", _in_plain_letters)
            stream.reconfigure(errors="plain")


#: Letters that a console may lack, and what is printed there.
_PLAIN = str.maketrans(
    {"µ": "u", "±": "+-", "…": "...", "–": "-", "−": "-", "°": " deg", "·": "*", "²": "^2",
     "√": "sqrt ", "→": "->", "≥": ">=", "≤": "<=", "×": "x", "χ": "chi",
     "∞": "inf", "⁻": "^-", "¹": "1"}
)  # fmt: skip


def _in_plain_letters(fault: UnicodeError) -> tuple[str, int]:
    """Replace what an encoding lacks by letters that mean the same, else by ?."""
    if not isinstance(fault, UnicodeEncodeError):
        raise fault
    told = fault.object[fault.start : fault.end].translate(_PLAIN)
    return told.encode("ascii", "replace").decode(), fault.end


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
    hint = "write it to a file with room for it"
    what = f"{what} cannot be written: {leave_stdout(fault)}"
    return UsageError(what, where="standard output", hint=hint)


def report(text: str, *, alone: bool = False) -> None:
    """Report on standard output; that it is full, or that nobody listens, changes nothing.

    alone : no file holds what is told, so that only a reader who leaves changes nothing; else it
    raises UsageError.
    """
    try:
        if alone and "stdout" in _closed:
            raise OSError(errno.EBADF, "it is closed")
        sys.stdout.write(text)
        sys.stdout.flush()
    except (OSError, ValueError) as fault:
        left = isinstance(fault, BrokenPipeError)
        if alone and not left:
            raise unwritten(fault, "the result") from fault
        reason = leave_stdout(fault)
        if not left:
            say(f"tdfscal: warning: standard output takes no more of the report: {reason}")


def say(text: str) -> None:
    """Write to standard error, where there is somebody to read it; line by line, all visible."""
    with contextlib.suppress(OSError, ValueError):
        print("\n".join(map(visible, text.split("\n"))), file=sys.stderr, flush=True)


def leave_stdout(fault: Exception | None = None) -> str:
    """Write nothing more to standard output, not even at the end of the program; return why."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
    return getattr(fault, "strerror", None) or str(fault)


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
    json, verbose, quiet = asked.pop("json"), asked.pop("verbose"), asked.pop("quiet")
    carried, places = _destinations(command, asked, json=json)
    began = time.monotonic()

    def stage(name: str) -> None:
        say(f"[{time.monotonic() - began:5.1f} s] {name} …")

    several = [path for p in command.parameters if p.several for path in asked.pop(p.name)]
    text = ""
    # Where standard output carries the result, it is an output like any other: all or none.
    with together():
        # Files stand one after the other there, as in `compare(a, b)`.
        result = command.call(_asked(), *several, progress=None if quiet else stage, **asked)
        written = result.exit_status == 0 or asked.get("allow_rejected", True)
        for note in result.notes:  # before the numbers that they concern, wherever these go
            say(f"tdfscal: warning: {note}")
        if json:
            hand_over(to_json(result.to_dict(), indent=1))
        elif carried and written:
            hand_over(getattr(result, carried))
        else:
            text = result.shown(whole=verbose)
            there = [visible(path) for path, holds in places if written or holds == "html"]
            if text and there:
                text += f"\nwrote {' and '.join(there)}\n"
    _listen(signal.SIG_IGN)  # all is done
    report(text, alone=not places and not result.kept)
    if result.exit_status and "allow_rejected" in asked:
        what = "it was written as rejected" if written else "nothing was written"
        if not written and "html" in asked:
            what = "only its page was written"
        say(f"tdfscal: the quality gate rejects this result; {what}")
    return result.exit_status


def _destinations(
    command: Command, asked: dict[str, Any], *, json: bool
) -> tuple[str | None, list[tuple[str, str]]]:
    """The text that `-` lets standard output carry; the files that are asked for, with theirs."""
    carried, places = None, list[tuple[str, str]]()
    for file in command.parameters:
        if file.writes is None or file.name not in asked:
            continue
        if str(asked[file.name]) != "-":
            places.append((str(asked[file.name]), file.holds))
            continue
        if not (file.dash and file.holds) or (json and file.holds == "html"):
            what, where = "standard output is taken by another result", f"{file.names[0]} -"
            raise UsageError(what, where=where, hint="name a file")
        del asked[file.name]
        carried = file.holds
    return carried, places
