"""How a run ends that does not end by itself: signals, full disks, faults; always in one line."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any

from tdfscal import memory
from tdfscal.cli.streams import Signalled, prepare, reporting, say
from tdfscal.errors import inaccessible

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70
#: Signals that end a run as an interruption does, with all cleaning up.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@dataclass(slots=True)
class End:
    """Status with which the program leaves; the signal that has ended it, if one has."""

    status: int = 0
    signal: int | None = None


@contextmanager
def ending() -> Iterator[End]:
    """Turn whatever ends the block into a status and one line on standard error."""
    end = End()
    prepare()
    before, hook = _listen(end), sys.unraisablehook
    sys.unraisablehook = _insisting(end, hook)
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
        sys.unraisablehook = hook
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


def _insisting(end: End, hook: Callable[[Any], object]) -> Callable[[Any], object]:
    """Signal again where the exception was raised in a place that cannot pass it on."""

    def again(lost: Any) -> None:
        if end.signal is None or not isinstance(lost.exc_value, Signalled):
            hook(lost)
            return
        timer = threading.Timer(0.05, os.kill, (os.getpid(), end.signal))
        timer.daemon = True
        timer.start()

    return again


def _listen(end: End) -> dict[int, Any]:
    """Let the signals raise; those that the caller ignores (nohup) stay ignored.

    Returns the handlers before.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        end.signal = number
        raise Signalled(number)

    before: dict[int, Any] = {}
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is None:
            continue
        try:
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, stop)
        except ValueError:  # not in the main thread: whoever runs it there has the signals
            break
    return before
