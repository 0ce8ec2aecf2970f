"""Which rig a RIG argument names, and which calibrations of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tdfscal.agreement import require_agreement
from tdfscal.cli.places import check_calibration
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


def calibrations_named(
    paths: Sequence[Path], rig: LoadedRig, taken: Sequence[str] = ()
) -> dict[str, Calibration]:
    """Load calibrations of the rig; each goes by its file's name, numbered where that is taken.

    Raises UsageError for a calibration of another rig; else as `load_calibration`.
    """
    named: dict[str, Calibration] = {}
    for path in paths:
        check_calibration(path)
        loaded = load_calibration(path)
        require_agreement(loaded.loaded_rig(path).rig, rig.rig, str(path))
        name = path.stem
        named[f"{name}-{len(named) + 1}" if name in (*named, *taken) else name] = loaded
    return named
