"""Which rig a RIG argument names, and which calibrations of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tdfscal.agreement import contradictions
from tdfscal.errors import UsageError
from tdfscal.files.calibration import Calibration, load_calibration
from tdfscal.files.campaign import RIG_NAME
from tdfscal.files.rig import LoadedRig, load_rig


def rig_named(path: Path) -> LoadedRig:
    """Load a rig file, or the rig.yaml of a campaign folder. Raises UsageError, RigError."""
    if path.is_dir():
        path = path / RIG_NAME
    if not path.is_file():
        raise UsageError(
            "there is no such rig file", where=str(path), hint="name a rig.yaml or its folder"
        )
    return load_rig(path)


def calibrations_named(paths: Sequence[Path], rig: LoadedRig) -> dict[str, Calibration]:
    """Load calibrations of the rig; each goes by its file's name, numbered where names repeat.

    Raises UsageError for a calibration of another rig; else as `load_calibration`.
    """
    named: dict[str, Calibration] = {}
    for path in paths:
        loaded = load_calibration(path)
        found = contradictions(loaded.loaded_rig(path).rig, rig.rig)
        if found:
            raise UsageError(
                f"this calibration is of another rig: {'; '.join(found)}",
                where=str(path),
                hint="name the rig file that was calibrated",
            )
        name = path.stem
        named[f"{name}-{len(named) + 1}" if name in named else name] = loaded
    return named
