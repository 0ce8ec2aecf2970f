"""`tdfscal info`."""

from __future__ import annotations

from tdfscal.cli import options
from tdfscal.cli.app import command
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CALIBRATE


@command(CALIBRATE, "info campaign/log.csv")
def info(
    paths: options.Paths,
    rig: options.RigFile = None,
    from_: options.From = None,
    to: options.To = None,
    figures: options.Figures = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Show what is in a log: fields, rates, gaps, dwells, problems, a mapping to paste."""
    return perform("info", locals()).exit_status
