"""Arithmetic on long columns without new arrays: memory, not arithmetic, is what costs time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.records import FloatArray


def dot(
    a: Sequence[FloatArray] | FloatArray,
    b: Sequence[FloatArray] | FloatArray,
    out: FloatArray,
    part: FloatArray,
) -> None:
    """Write Σ aₖ bₖ into out; part, of the same shape, is overwritten."""
    np.multiply(a[0], b[0], out=out)
    for x, y in zip(a[1:], b[1:], strict=True):
        np.multiply(x, y, out=part)
        out += part
