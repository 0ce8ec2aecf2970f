"""Standard output and error: a report may fail there unnoticed, a result may not."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from typing import Any

from tdfscal.errors import UsageError, visible

#: Streams that were closed before the program began.
_closed: set[str] = set()


class Signalled(BaseException):
    """A signal has ended the run."""


def prepare() -> None:
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
