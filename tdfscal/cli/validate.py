"""`tdfscal validate`."""

from __future__ import annotations

from tdfscal.cli.app import CalibrationFile, Html, Json, Paths, Quiet, RigFile, app
from tdfscal.cli.perform import perform


@app.command()
def validate(
    calibration: CalibrationFile,
    paths: Paths,
    rig: RigFile = None,
    html: Html = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Check a calibration on static postures without contact: still valid, or what changed."""
    return perform("validate", locals()).exit_status
