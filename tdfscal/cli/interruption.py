"""The signal that ends a run: heard wherever it meets Python, and raised until the run ends.

What is raised inside a callback may be dropped there: by pydantic's and numpy's C, by a weak
reference that dies, by a module's lock.
"""

from __future__ import annotations

import _thread
import contextlib
import signal
import sys
import time
from collections.abc import Iterator
from contextvars import ContextVar
from types import FrameType
from typing import Any

#: Signals that end a run as an interruption does, with all cleaning up.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
#: Until it is looked whether what was raised has ended the run, s.
_SOON = 0.01


class Signalled(BaseException):
    """A signal, whose number it has, has ended the run."""


class Interruption:
    """Of one run: the number of the signal that came first, None until then."""

    def __init__(self) -> None:
        self.number: int | None = None
        self._held = False
        self._over = False
        self._ending = _thread.allocate_lock()

    def meet(self, number: int, frame: FrameType | None) -> None:
        """Take a signal: raise, unless what was raised is on its way or has nothing to end."""
        del frame
        if self.number is None:
            self.number = number
            _thread.start_new_thread(self._come_again, ())
        if not (self._over or self._held or _is_on_its_way()):
            raise Signalled(self.number)

    def _come_again(self) -> None:
        while True:
            time.sleep(_SOON)
            with self._ending:
                if self._over or self.number is None:
                    return
                _thread.interrupt_main(self.number)  # type: ignore[arg-type]

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Let the block be done whole or, where a signal came before, not at all."""
        self._held = True
        try:
            if self.number is not None and not self._over:
                raise Signalled(self.number)
            yield
        finally:
            self._held = False

    def end(self) -> None:
        """Let no signal end the run any more."""
        self._over = True
        with self._ending:  # what comes again has looked at that
            pass


#: That of the run under way.
current: ContextVar[Interruption] = ContextVar("interruption", default=Interruption())  # noqa: B039


def _is_on_its_way() -> bool:
    """Whether the code that the signal meets cleans up after one."""
    met = sys.exc_info()[1]
    while met is not None and not isinstance(met, Signalled):
        met = met.__context__
    return met is not None


@contextlib.contextmanager
def listening(one: Interruption, *, last: bool = False) -> Iterator[None]:
    """Let the signals end what is inside; those that the caller ignores (nohup) stay ignored.

    last : behind it they end nothing.
    """
    before, hook = dict[int, Any](), sys.unraisablehook
    token, sys.unraisablehook = current.set(one), _unless_signalled
    try:
        with contextlib.suppress(ValueError):  # not in the main thread: its owner has the signals
            for number in (getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)):
                if signal.getsignal(number) is not signal.SIG_IGN:
                    before[number] = signal.signal(number, one.meet)
        yield
    finally:
        one.end()
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if last else handler)
        sys.unraisablehook = hook
        current.reset(token)


def _unless_signalled(met: sys.UnraisableHookArgs) -> None:
    if not isinstance(met.exc_value, Signalled):
        sys.__unraisablehook__(met)
