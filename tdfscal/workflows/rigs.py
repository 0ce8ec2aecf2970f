"""Which rig a RIG argument names, which survey it declares, and which calibrations there are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from tdfscal.checks.same_rig import require_agreement
from tdfscal.errors import UsageError
from tdfscal.files import RIG_NAME
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.simulation import SurveyOptions
from tdfscal.workflows.arguments import PathLike
from tdfscal.workflows.calibration import Calibration, CalibrationSource, read_source


def rig_named(path: PathLike) -> LoadedRig:
    """Load a rig file, or the rig.yaml of a campaign folder. Raises UsageError, RigError."""
    file = Path(path)
    if file.is_dir():
        file = file / RIG_NAME
    if not file.is_file():
        raise UsageError(
            "there is no such rig file", where=str(file), hint="name a rig.yaml or its folder"
        )
    return load_rig(file)


def calibrations_named(
    sources: Sequence[CalibrationSource], rig: LoadedRig, taken: Sequence[str] = ()
) -> dict[str, Calibration]:
    """Load calibrations of the rig; each goes by its file's name, numbered where that is taken.

    Raises UsageError for a calibration of another rig; else as `load_calibration`.
    """
    named: dict[str, Calibration] = {}
    for source in sources:
        path, loaded = read_source(source)
        require_agreement(loaded.loaded_rig(path).rig, rig.rig, path)
        name = Path(path).stem
        named[f"{name}-{len(named) + 1}" if name in (*named, *taken) else name] = loaded
    return named


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
