"""Logs of which each row is one static posture, averaged already: rows as dwells."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.records import Dwells, FloatArray, IntArray, Log

_DIGITS = range(9, 1, -1)  # after the point, that files are rounded to in m and N
_EPS = 1e-12


def postures_as_dwells(pieces: Iterable[Log]) -> Dwells:
    """Each row is one dwell: mean as recorded, covariance zero, one sample.

    A row that repeats an earlier one is the same recording (a copy of a file, an export to a second
    format, doubled rows); it counts once, and a warning says so.

    Raises
    ------
    DataError
        where the streams have different numbers of rows, or a reading is not a number.
    """
    logs = list(pieces)
    supports = logs[0].supports
    if any(log.supports != supports for log in logs):
        raise DataError("the logs name different supports", hint="give logs of one rig")
    time, position, force = [], [], []
    for log in logs:
        rows = {len(series.time) for series in (*log.position, *log.force)}
        if len(rows) != 1:
            raise DataError(
                f"the streams hold different numbers of postures, {sorted(rows)}",
                hint="give one row per posture with every position and force",
            )
        time.append(log.force[0].time)
        position.append(np.stack([s.value for s in log.position], axis=1))
        force.append(np.stack([s.value for s in log.force], axis=1))
    t, p, f = np.concatenate(time), np.concatenate(position), np.concatenate(force)
    if not len(t):
        raise DataError("the log holds no posture", hint="give one row per posture")
    for row in np.flatnonzero(~(np.isfinite(p) & np.isfinite(f)).all(axis=(1, 2))):
        raise DataError(
            "a reading is not a number", where=f"posture {row + 1}", hint="leave this posture out"
        )
    keep, found = _once(position, force)
    t, p, f = t[keep], p[keep], f[keep]
    zero = np.zeros((*f.shape, 3))
    return Dwells(
        supports=supports,
        start=t,
        end=t.copy(),
        position=p,
        position_cov=zero,
        force=f,
        force_cov=zero.copy(),
        force_min=f.copy(),
        force_max=f.copy(),
        count=np.ones(f.shape[:2], dtype=np.int64),
        effective=np.ones(f.shape[:2]),
        findings=found,
        force_range=np.stack([f.min(axis=0), f.max(axis=0)]),
    )


def _once(
    position: list[FloatArray], force: list[FloatArray]
) -> tuple[IntArray, tuple[Finding, ...]]:
    """Rows of all files to keep, each once, and what to say of the others.

    Rows are compared as far as the file with the fewest digits resolves each column.
    """
    files = [
        np.concatenate(of, axis=1).reshape(len(of[0]), -1)
        for of in zip(position, force, strict=True)
    ]
    value = np.concatenate(files)
    resolution = np.max([_resolution(own) for own in files], axis=0)
    resolution = np.maximum(resolution, _EPS * (1.0 + np.abs(value).max(axis=0)))
    steps = np.round(value / resolution)
    first, group = np.unique(steps, axis=0, return_index=True, return_inverse=True)[1:]
    earlier = first[group.ravel()]
    later = np.flatnonzero(earlier < np.arange(len(value)))
    if not len(later):
        return np.arange(len(value)), ()
    values: dict[str, Value] = {
        "postures": len(value),
        "later": int(later[0]) + 1,
        "earlier": int(earlier[later[0]]) + 1,
    }
    return np.sort(first), (Finding("postures-repeated", size=len(later), values=values),)


def _resolution(value: FloatArray) -> FloatArray:
    """Power of ten (6n,) that all readings (K, 6n) of a column are multiples of; 0 for none."""
    resolution = np.zeros(value.shape[1])
    for digits in _DIGITS:
        rest = np.abs(np.round(value, digits) - value)
        coarse = (rest <= _EPS * (1.0 + np.abs(value))).all(axis=0)
        resolution[coarse] = 10.0**-digits
    return resolution
