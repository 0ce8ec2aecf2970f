"""The command line: parse, call, print. What a command needs is imported inside it."""

import _thread
import gc
import sys
import time

#: Until a signal that nothing could be raised of comes again, s.
_SOON = 0.01


class Signalled(BaseException):
    """A signal, whose number it has, has ended the run."""


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    status, before = 130, sys.unraisablehook
    gc.set_threshold(50_000)  # what modules and models are made of stays: few cycles to search for
    sys.unraisablehook = _come_again
    try:
        # All imports of weight lie inside, so that an interruption among them ends quietly too.
        from tdfscal.cli.process import ending

        with ending() as end:
            from tdfscal.cli.app import run

            end.status = run()
        status = end.status
        # What is left ends with the process: no last search of all of it for cycles.
        gc.freeze()
    except KeyboardInterrupt:  # before `ending` listened, or after
        if status == 130:
            sys.stderr.write("tdfscal: interrupted; nothing was written\n")
    finally:
        sys.unraisablehook = before
    sys.exit(status)


def _come_again(met: "sys.UnraisableHookArgs") -> None:
    """Let a signal come again that met Python in a callback, out of which nothing is raised.

    As a weak reference dies, a module's lock or an object goes, it would be printed and lost.
    """
    if not isinstance(met.exc_value, KeyboardInterrupt | Signalled):
        sys.__unraisablehook__(met)
        return

    def again(number: int = 2) -> None:  # SIGINT
        time.sleep(_SOON)
        _thread.interrupt_main(number)  # type: ignore[arg-type]

    _thread.start_new_thread(again, met.exc_value.args[:1])


__all__ = ["main"]
