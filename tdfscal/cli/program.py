"""All commands of the program, which the help lists by purpose."""

from __future__ import annotations

import os
import sys
import warnings
from functools import cache
from typing import Any

import typer
import typer.main

from tdfscal import memory
from tdfscal.cli import commands  # noqa: F401 - registers the commands
from tdfscal.cli.app import app
from tdfscal.cli.streams import say
from tdfscal.cli.words import mistake, misuse, plainly_typed
from tdfscal.errors import TdfscalError

#: What typer makes of an interruption.
INTERRUPTED = 130


@cache
def command() -> Any:
    """The commands as typer makes them of their functions, once."""
    made = typer.main.get_command(app)
    plainly_typed(made)
    return made


def run() -> int:
    """Run the command that the command line asks for; return the exit status."""
    if not sys.warnoptions:  # what concerns a user is in the result
        warnings.simplefilter("ignore")
    if not os.environ.get("SOURCE_DATE_EPOCH", "0").isdecimal():
        del os.environ["SOURCE_DATE_EPOCH"]  # libraries fall over a date that is none
    try:
        status: int = command()(standalone_mode=False, prog_name="tdfscal") or 0
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
