"""Which rig a RIG argument names."""

from __future__ import annotations

from pathlib import Path

from tdfscal.errors import UsageError
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
