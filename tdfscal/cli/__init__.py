"""The command line: parse, call, print. What a command needs is imported inside it."""

from __future__ import annotations

import os
import sys

from tdfscal.cli import commands  # noqa: F401 - registers the commands
from tdfscal.cli.app import app
from tdfscal.errors import TdfscalError

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    try:
        app()
    except TdfscalError as error:
        print(f"tdfscal: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except KeyboardInterrupt:
        print("tdfscal: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # the reader of our standard output has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        print(
            f"tdfscal: {error.filename or 'the output'} cannot be read or written: "
            f"{error.strerror or error}. Make room, or choose another place.",
            file=sys.stderr,
        )
        sys.exit(2)
    except Exception as error:
        if os.environ.get("TDFSCAL_TRACEBACK"):
            raise
        print(
            f"tdfscal: internal error, {type(error).__name__}: {error}. This is a fault of "
            "tdfscal, not of your data; run again with TDFSCAL_TRACEBACK=1 and report the output.",
            file=sys.stderr,
        )
        sys.exit(INTERNAL_ERROR)


__all__ = ["app", "main"]
