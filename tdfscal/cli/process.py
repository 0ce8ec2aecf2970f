"""The process: its standard streams, and how a run ends; always with a status and in one line.

A report may fail on standard output unnoticed, a result may not.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType
from typing import Any

from tdfscal import memory
from tdfscal.errors import UsageError, inaccessible, visible

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70
#: Signals that end a run as an interruption does, with all cleaning up.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
#: Streams that were closed before the program began.
_closed: set[str] = set()


class Signalled(BaseException):
    """A signal has ended the run."""


@dataclass(slots=True)
class End:
    """Status with which the program leaves; the signal that has ended it, if one has."""

    status: int = 0
    signal: int | None = None


@contextlib.contextmanager
def ending() -> Iterator[End]:
    """Turn whatever ends the block into a status and one line on standard error."""
    end = End()
    _prepare_streams()
    before = _listen(end)
    try:
        yield end
        with reporting():
            pass
    except KeyboardInterrupt:
        end.status = 130
        say("tdfscal: interrupted; nothing was written")
    except BaseException as fault:
        # Some code between makes another exception of a signal's.
        if end.signal is None:
            end.status, text = _judged(fault)
        else:
            end.status, text = 128 + end.signal, "interrupted; nothing was written"
        say(f"tdfscal: {text}")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _judged(fault: BaseException) -> tuple[int, str]:
    """Status and words for what no command foresees."""
    if os.environ.get("TDFSCAL_TRACEBACK") or isinstance(fault, SystemExit):
        raise fault
    if memory.is_short(fault):
        error = memory.shortage()
        return error.exit_status, str(error)
    if isinstance(fault, OSError):
        return 2, str(inaccessible(fault))
    said = " ".join(str(fault).split())
    return INTERNAL_ERROR, (
        f"internal error, {type(fault).__name__}: {said}. This is a fault of "
        "tdfscal, not of your data; run again with TDFSCAL_TRACEBACK=1 and report the output."
    )


def _listen(end: End) -> dict[int, Any]:
    """Let the signals raise; those that the caller ignores (nohup) stay ignored.

    Returns the handlers before.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        end.signal = number
        raise Signalled(number)

    before: dict[int, Any] = {}
    with contextlib.suppress(ValueError):  # not in the main thread: its owner has the signals
        for number in (getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)):
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, stop)
    return before


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
