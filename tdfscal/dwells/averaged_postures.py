"""Logs whose rows are averaged postures already."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tdfscal.errors import DataError
from tdfscal.records import Dwells, Log


def postures_as_dwells(pieces: Iterable[Log]) -> Dwells:
    """Each row is one dwell: mean as recorded, covariance zero, one sample.

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
    )
