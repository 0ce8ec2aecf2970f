"""Logs whose rows are averaged postures already."""

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
    """Rows of all files to keep, each once, and what to say of the others."""
    files = list(zip(position, force, strict=True))
    value = np.concatenate([np.concatenate(of, axis=1).reshape(len(of[0]), -1) for of in files])
    resolution = np.concatenate([np.tile(_resolution(*of), (len(of[0]), 1)) for of in files])
    repeats = _repeated(value, resolution)
    if not repeats:
        return np.arange(len(value)), ()
    later, earlier = min(repeats.items())
    values: dict[str, Value] = {
        "postures": len(value),
        "later": later + 1,
        "earlier": earlier + 1,
    }
    said = Finding("postures-repeated", size=len(repeats), values=values)
    return np.setdiff1d(np.arange(len(value)), list(repeats)), (said,)


def _resolution(position: FloatArray, force: FloatArray) -> FloatArray:
    """Power of ten (6n,) that all readings of a file's columns are multiples of; 0 for none."""
    value = np.concatenate([position, force], axis=1).reshape(len(position), -1)
    resolution = np.zeros(value.shape[1])
    for digits in _DIGITS:
        rest = np.abs(np.round(value, digits) - value)
        coarse = (rest <= _EPS * (1.0 + np.abs(value))).all(axis=0)
        resolution[coarse] = 10.0**-digits
    return resolution


def _repeated(value: FloatArray, resolution: FloatArray) -> dict[int, int]:
    """Rows (K, A) that equal an earlier one as far as both are resolved: row → that one."""
    repeats: dict[int, int] = {}
    lively = int(np.argmax([len(np.unique(column)) for column in value.T]))
    key = value[:, lively]
    order = np.argsort(key, kind="stable")
    reach = 1.02 * float(resolution[:, lively].max()) + _EPS * float(np.abs(key).max())
    for step in range(1, len(value)):
        a, b = order[:-step], order[step:]
        close = key[b] - key[a] <= reach
        if not close.any():
            break
        a, b = a[close], b[close]
        limit = 0.51 * (resolution[a] + resolution[b]) + _EPS * np.abs(value[a])
        same = (np.abs(value[a] - value[b]) <= limit).all(axis=1)
        for one, other in zip(a[same].tolist(), b[same].tolist(), strict=True):
            first, second = sorted((one, other))
            repeats[second] = min(first, repeats.get(second, first))
    return repeats
