"""CSV: one row per sensor, rotation matrix by rows."""

from __future__ import annotations

import csv
import io

import numpy as np

from tdfscal.exports.words import number
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.escaping import csv_cell
from tdfscal.records import ANGLES

_AXES = "xyz"


def csv_table(c: Calibration) -> str:
    """Return a row per sensor: r_xx … r_zz, zero in N, inverse sensitivity u_xx … u_zz; roll,
    pitch, yaw in degrees, their standard uncertainties in rad, the zero's in N; convention.

    F_bcs = r · u · (F_sensor − zero); u = (I + S)⁻¹ stands only where a sensitivity was estimated.
    """
    scaled = any(support.sensitivity for support in c.supports)
    header = ["sensor", *_names("r"), *(f"zero_{a}" for a in _AXES)]
    header += _names("u") if scaled else []
    header += [f"{angle}_deg" for angle in ANGLES] + [f"std_{angle}" for angle in ANGLES]
    header += [f"std_zero_{a}" for a in _AXES]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*header, "status", "created", "convention"])
    for support, mixing in zip(c.supports, c.sensitivity, strict=True):
        if support.rotation is None:
            continue
        row = [number(v) for v in np.array(support.rotation).ravel()]
        row += [number(v) for v in support.offset]
        row += [number(v) for v in np.linalg.inv(mixing).ravel()] if scaled else []
        mounting = support.mounting
        assert mounting is not None  # it has a rotation
        row += [number(v) for v in np.degrees(mounting.rpy)]
        stds = (*support.rpy_std, *support.zero_std)
        row += ["" if std is None else number(std) for std in stds]
        writer.writerow([csv_cell(support.name), *row, c.status, c.created, c.convention])
    return stream.getvalue()


def _names(letter: str) -> list[str]:
    return [f"{letter}_{a}{b}" for a in _AXES for b in _AXES]
