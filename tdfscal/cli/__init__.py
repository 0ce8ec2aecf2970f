"""The command line: parse, call, print. What a command needs is imported inside it."""

import gc
import sys

from tdfscal.cli.interruption import Interruption, listening


def main(*, last: bool = False) -> None:
    """Run the command line and leave with the contract's exit status.

    last : nothing follows in this process, whose end no signal may turn into another status.
    """
    status, interruption = None, Interruption()
    gc.set_threshold(50_000)  # what modules and models are made of stays: few cycles to search for
    try:
        with listening(interruption, last=last):
            # All imports of weight lie inside, so that an interruption among them ends quietly too.
            from tdfscal.cli.process import ending

            with ending() as end:
                from tdfscal.cli.app import run

                end.status = run()
            status = end.status
            # What is left ends with the process: no last search of all of it for cycles.
            gc.freeze()
    except BaseException as fault:  # before `ending` listened, or after
        if interruption.number is None and not isinstance(fault, KeyboardInterrupt):
            raise
        if status is None:
            status = 128 + (interruption.number or 2)
            sys.stderr.write("tdfscal: interrupted; nothing was written\n")
    sys.exit(status)


__all__ = ["main"]
