"""The command line: parse, call, print. What a command needs is imported inside it."""

from __future__ import annotations

import os
import sys

from tdfscal.cli import commands  # noqa: F401 - registers the commands
from tdfscal.cli.app import app
from tdfscal.errors import TdfscalError


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    try:
        app()
    except TdfscalError as error:
        print(f"tdfscal: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except BrokenPipeError:  # the reader of our standard output has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


__all__ = ["app", "main"]
