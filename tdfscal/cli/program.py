"""Running what the command line asks for."""

from __future__ import annotations

import os
import sys
import warnings

import typer
import typer.main

from tdfscal import memory
from tdfscal.cli.app import app
from tdfscal.cli.streams import say
from tdfscal.cli.words import mistake, misuse
from tdfscal.errors import TdfscalError

#: What typer makes of an interruption.
INTERRUPTED = 130


def run() -> int:
    """Run the command that the command line asks for; return the exit status."""
    if not sys.warnoptions:  # what concerns a user is in the result
        warnings.simplefilter("ignore")
    if not os.environ.get("SOURCE_DATE_EPOCH", "0").isdecimal():
        del os.environ["SOURCE_DATE_EPOCH"]  # libraries fall over a date that is none
    try:
        status: int = typer.main.get_command(app)(standalone_mode=False, prog_name="tdfscal") or 0
    except TdfscalError as error:
        if memory.is_short(error):  # what else it says was judged without a look at that
            error = memory.shortage()
        say(f"tdfscal: {error}")
        return error.exit_status
    except misuse() as error:
        say(f"tdfscal: {mistake(error)}")
        return 2
    except typer.Abort:
        status = INTERRUPTED
    if status == INTERRUPTED:
        raise KeyboardInterrupt
    return status


__all__ = ["app", "run"]
