"""Results of tdfscal that lie among recordings: known by their first line, or their description."""

from __future__ import annotations

from pathlib import Path

from tdfscal.files.writers.wrench_recording import LIBRARY

#: How the first line of each table begins: plan, contact wrenches, exported rotations, studies.
_FIRST_LINES = (
    b"# tdfscal ",
    b"time,fx,fy,fz,mx,my,mz,u_fx,",
    b"sensor,r_xx,r_xy,r_xz,",
    b"posture_roll,posture_pitch,posture_yaw,internal_N,",
    b"calibration,posture_roll,posture_pitch,posture_yaw,",
    b"method,support,angle,",
    b"method,run,",
    b"calibration,move,run,",
    b"calibration,run,",
)
#: What the metadata of a Parquet file of contact wrenches say, at the end of the file.
_QUANTITY = b"contact wrench on the terminal: force, and moment"
_TAIL = 1 << 16
#: Who wrote a recording of contact wrenches, in its first record.
_RECORDING = LIBRARY.encode()


def is_own_result(path: Path) -> bool:
    """Tell whether a file is a result of tdfscal and no recording."""
    try:
        with path.open("rb") as file:
            if path.suffix.lower() == ".mcap":
                return _RECORDING in file.read(256)
            if path.suffix.lower() != ".parquet":
                return file.read(256).replace(b'"', b"").startswith(_FIRST_LINES)
            size = file.seek(0, 2)
            file.seek(max(0, size - _TAIL))
            return _QUANTITY in file.read(_TAIL)
    except OSError:
        return False
