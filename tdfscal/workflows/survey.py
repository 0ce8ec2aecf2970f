"""A laser tracker's survey: as the rig file declares it, and from its files to a calibration."""

from __future__ import annotations

import math

import numpy as np

from tdfscal.errors import DataError, UsageError
from tdfscal.files.hashing import input_file, note_outside
from tdfscal.files.points.reading import read_tracker_session
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.records import InputFile
from tdfscal.simulation import SurveyOptions
from tdfscal.trackercal import TrackerCalibration, calibrate_tracker
from tdfscal.workflows.campaign import Campaign


def surveyed(
    campaign: Campaign, trials: int | None, rng: np.random.Generator
) -> tuple[TrackerCalibration, list[InputFile], tuple[str, ...]]:
    """Calibrate from a survey; also return its files, and what is to be said of them.

    Raises UsageError where the rig file declares none, DataError where its files are unusable.
    """
    files = campaign.rig.tracker
    if files is None:
        raise UsageError(
            "the rig file declares no tracker survey",
            where=str(campaign.rig.path),
            hint="add its tracker block, or use --method self",
        )
    for path in files.paths:
        if not path.is_file():
            raise DataError(
                "the point file is not there",
                where=str(path),
                hint="correct the paths of the tracker block in rig.yaml",
            )
    session, notes = read_tracker_session(files)
    options = {} if trials is None else {"trials": trials}
    result = calibrate_tracker(
        campaign.rig.rig, session, misalignment=files.stated.misalignment, rng=rng, **options
    )
    folder = campaign.rig.path.parent
    inputs = [
        input_file(path, "verified", note_outside(path, folder, campaign.rig.path.name))
        for path in files.paths
    ]
    return result, inputs, notes


def survey_of(loaded: LoadedRig, distance: float = 5.0) -> SurveyOptions:
    """Take the survey that the rig file declares, or the paper's."""
    if not 0.0 < distance < math.inf:
        raise UsageError(f"the tracker stands {distance:g} m away", hint="give metres above zero")
    if (files := loaded.tracker) is None:
        return SurveyOptions(distance=distance)
    return SurveyOptions(
        instrument=files.instrument,
        distance=distance,
        drawing=files.stated.drawing,
        body_misalignment=files.stated.misalignment,
    )
