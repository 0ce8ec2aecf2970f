"""`tdfscal info`."""

from __future__ import annotations

from tdfscal.cli.app import Figures, From, Json, Paths, Quiet, RigFile, To, app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import CALIBRATE, example


@app.command(rich_help_panel=CALIBRATE, epilog=example("tdfscal info campaign/log.csv"))
def info(
    paths: Paths,
    rig: RigFile = None,
    from_: From = None,
    to: To = None,
    figures: Figures = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Show what is in a log: fields, rates, gaps, dwells, problems, a mapping to paste."""
    return perform("info", locals()).exit_status
