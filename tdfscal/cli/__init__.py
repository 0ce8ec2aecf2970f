"""The command line: parse, call, print. What a command needs is imported inside it."""

import gc
import sys


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    gc.set_threshold(50_000)  # what modules and models are made of stays: few cycles to search for
    try:
        from tdfscal.cli.process import status

        found = status()
    except KeyboardInterrupt:  # among the first imports
        sys.exit(130)
    gc.freeze()  # what is left ends with the process: no last search of all of it
    sys.exit(found)


__all__ = ["main"]
