"""The command line: parse, call, print. What a command needs is imported inside it."""

from __future__ import annotations

import gc
import sys


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    from tdfscal.cli.ending import ending

    with ending() as end:
        # All imports of weight lie inside, so that an interruption among them ends quietly too.
        from tdfscal.cli.program import run

        end.status = run()
    # What is left ends with the process: no last search of all of it for cycles.
    gc.freeze()
    sys.exit(end.status)


__all__ = ["main"]
