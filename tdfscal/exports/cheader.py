"""C header: constants and one function that turns a reading."""

from __future__ import annotations

import numpy as np

from tdfscal.exports.thresholds import ContactThresholds
from tdfscal.exports.words import number, origin, uncertain
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.escaping import c_comment
from tdfscal.records import FloatArray

_FUNCTION = """\
/* Force of sensor i on the terminal in the BCS, N; reading and force may be one array. */
static inline void tdfscal_force_bcs(int i, const double reading[3], double force[3])
{
    double load[3], sum[3];
    int a, b;
    for (a = 0; a < 3; ++a)
        load[a] = reading[a] - tdfscal_zero[i][a];
    for (a = 0; a < 3; ++a) {
        sum[a] = 0.0;
        for (b = 0; b < 3; ++b)
            sum[a] += tdfscal_matrix[i][a][b] * load[b];
    }
    for (a = 0; a < 3; ++a)
        force[a] = sum[a];
}
"""


def c_header(c: Calibration, limits: ContactThresholds | None = None) -> str:
    """Return a C99 and C++ header without dependencies.

    tdfscal_matrix is the rotation, times the inverse sensitivity where one was estimated.
    """
    scaled = any(support.sensitivity for support in c.supports)
    stand = c.determined
    rotation = c.rotation[stand]
    matrix = rotation @ np.linalg.inv(c.sensitivity[stand]) if scaled else rotation
    notes = [*origin(c), "Rows of a matrix are the BCS's axes, columns the sensor's."]
    notes += [f"{s.name}: {uncertain(s)}" for s in c.supports if s.mounting is not None]
    names = ", ".join(f'"{support.name}"' for support in c.mounted)
    n = len(c.mounted)
    lines = ["/*", *(f" * {c_comment(note)}" for note in notes), " */"]
    lines += ["#ifndef TDFSCAL_CALIBRATION_H", "#define TDFSCAL_CALIBRATION_H", ""]
    lines += [f"#define TDFSCAL_SENSORS {n}", ""]
    lines += [f"static const char *const tdfscal_sensor[TDFSCAL_SENSORS] = {{{names}}};", ""]
    lines += _matrices("tdfscal_rotation", rotation)
    lines += _matrices("tdfscal_matrix", matrix)
    lines += ["/* N, sensor frames */"]
    rows = ",\n".join(f"    {_row(zero)}" for zero in c.zero[stand])
    lines += [f"static const double tdfscal_zero[TDFSCAL_SENSORS][3] = {{\n{rows}\n}};", ""]
    if limits is not None and limits.bounded:
        lines += ["/*", *(f" * {c_comment(note)}" for note in limits.notes), " */"]
        lines += [f"static const double tdfscal_threshold[6] = {_row(limits.value)};", ""]
    return "\n".join(lines) + f"\n{_FUNCTION}\n#endif\n"


def _matrices(name: str, values: FloatArray) -> list[str]:
    blocks = ",\n".join(
        "    {" + ",\n     ".join(_row(row) for row in matrix) + "}" for matrix in values
    )
    return [f"static const double {name}[TDFSCAL_SENSORS][3][3] = {{\n{blocks}\n}};", ""]


def _row(values: FloatArray) -> str:
    return "{" + ", ".join(number(v) for v in values) + "}"
