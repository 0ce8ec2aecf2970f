"""The command line: parse, call, print. What a command needs is imported inside it."""

import gc
import sys


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    status = 130
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
    sys.exit(status)


__all__ = ["main"]
