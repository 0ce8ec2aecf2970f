"""Scales and squarenesses of three axes: what a linear map does beyond a rotation."""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray


def affine_columns(servo: FloatArray) -> FloatArray:
    """Displacement (N, 3, 6), m per unit, of points servo (N, 3), m, about their origin.

    Columns: relative scale of x, y, z; squareness s of yz, zx, xy in rad, the angle between the
    two axes being 90° + s, which is a symmetric shear of −s/2 on either side.
    """
    columns = np.zeros((len(servo), 3, 6))
    for k in range(3):
        columns[:, k, k] = servo[:, k]
        i, j = (k + 1) % 3, (k + 2) % 3
        columns[:, i, 3 + k] = -servo[:, j] / 2
        columns[:, j, 3 + k] = -servo[:, i] / 2
    return columns
