"""`update`: the last calibration, as what is known before, its walk since, and new campaigns."""

from __future__ import annotations

from typing import Annotated

from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike, campaign_folders
from tdfscal.commands.earlier import read_earlier
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import silent, window
from tdfscal.commands.result import Calibration
from tdfscal.commands.several_campaigns import calibrate_several
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES


@options.command("update calibration.yaml this-month -o updated.yaml")
def update(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    from_: options.Begin = None,
    to: options.End = None,
    trials: options.Trials = None,
    output: Annotated[
        PathLike | None,
        options.written(
            "file to write, .yaml or .json", *CALIBRATION_SUFFIXES, shell="- for stdout"
        ),
    ] = None,
    html: options.Page = None,
    allow_rejected: options.AllowRejected = False,
    progress: options.Telling = silent,
    command: str = "",
) -> Calibration:
    """Bring a calibration up to date with a new campaign: zeros, load, angles.

    The last calibration with its full covariance, widened by the random walk `drift.angle` since,
    is what is known before; one posture is enough to find new zeros. Of several campaigns one that
    `calibrate` rejects by itself takes no part, unless it is the last.
    """
    settings = Settings(progress, window(from_, to), trials=trials, command=command)
    return calibrate_several(campaign_folders(paths, rig), settings, rig, read_earlier(calibration))
