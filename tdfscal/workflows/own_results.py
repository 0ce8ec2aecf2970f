"""Results of tdfscal that lie among recordings: known by what they say of themselves."""

from __future__ import annotations

import re
from pathlib import Path

from tdfscal.files.writers.wrenches import LIBRARY

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
#: What else they say near their begin: exports, pages, certificates, documents, drafts.
_SAID = re.compile(
    rb"""\btdfscal[ ]\d[^\s,]*,[ ]method[ ]
    | <meta[ ]name="generator"[ ]content="tdfscal[ ]
    | <dcc:content[ ]lang="en">tdfscal</dcc:content>
    | ^[ ]*"?format"?:[ ]*"?tdfscal-
    | ^\#[ ]Drafted[ ]by[ ]`tdfscal[ ]""",
    re.VERBOSE | re.MULTILINE,
)
_HEAD = 1 << 14
#: What the metadata of a Parquet file of contact wrenches say, at the end of the file.
_QUANTITY = b"contact wrench on the terminal: force, and moment"
_TAIL = 1 << 16
#: Who wrote a recording of contact wrenches, in its first record.
_RECORDING = LIBRARY.encode()


def is_own_result(path: Path) -> bool:
    """Tell whether a file is a result of tdfscal and no recording."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            if head.replace(b'"', b"").startswith(_FIRST_LINES) or _SAID.search(head):
                return True
            if path.suffix.lower() == ".mcap":
                return _RECORDING in head[:256]
            if path.suffix.lower() != ".parquet":
                return False
            size = file.seek(0, 2)
            file.seek(max(0, size - _TAIL))
            return _QUANTITY in file.read(_TAIL)
    except OSError:
        return False
