"""The command line: parse, call, print. What a command needs is imported inside it."""

from __future__ import annotations

import os
import sys

import typer

# Each module registers its command, in the order in which the help lists them.
from tdfscal.cli import (  # noqa: F401
    apply,
    calibrate,
    compare,
    export,
    info,
    init,
    monitor,
    plan,
    register,
    report,
    schema,
    simulate,
    study,
    update,
    validate,
)
from tdfscal.cli.app import app
from tdfscal.errors import TdfscalError, visible

#: BSD's EX_SOFTWARE: none of the contract's statuses, which speak of the user's input.
INTERNAL_ERROR = 70
#: What typer raises for a faulty command line, whichever click it carries.
_Misuse: type[Exception] = typer.BadParameter.__bases__[0]


def main() -> None:
    """Run the command line and leave with the contract's exit status."""
    sys.exit(_status())


def _status() -> int:
    try:
        status = app(standalone_mode=False, prog_name="tdfscal")
    except TdfscalError as error:
        return _say(str(error), error.exit_status)
    except _Misuse as error:
        return _say(_usage(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        status = 130
    except BrokenPipeError:  # the reader of our standard output has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _say(
            f"{error.filename or 'the output'} cannot be read or written: "
            f"{error.strerror or error}. Make room, or choose another place.",
            2,
        )
    except Exception as error:
        if os.environ.get("TDFSCAL_TRACEBACK"):
            raise
        return _say(
            f"internal error, {type(error).__name__}: {error}. This is a fault of tdfscal, not of "
            "your data; run again with TDFSCAL_TRACEBACK=1 and report the output.",
            INTERNAL_ERROR,
        )
    if status == 130:
        return _say("interrupted; nothing was written", 130)
    return status or 0


def _say(text: str, status: int) -> int:
    print("\n".join(map(visible, f"tdfscal: {text}".split("\n"))), file=sys.stderr)
    return status


def _usage(error: Exception) -> str:
    """Say what is wrong with a command line, in one paragraph; the help where it is bare."""
    said = str(error.format_message())  # type: ignore[attr-defined]
    if said.startswith("Usage:"):
        return f"no command is given\n\n{said}"
    path = getattr(getattr(error, "ctx", None), "command_path", "tdfscal")
    said = " ".join(said.split()).rstrip(".").replace("'?", "'")
    return f"{said}. Try '{path} --help'."


__all__ = ["app", "main"]
