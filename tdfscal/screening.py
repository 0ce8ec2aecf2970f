"""Sensors that lie before any model is asked: saturated, frozen, dead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError
from tdfscal.records import BoolArray, Dwells, Rig

AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Screened:
    """Which dwells may be used (K,), and the reason for each that may not."""

    keep: BoolArray
    reasons: dict[int, str]


def screen(rig: Rig, dwells: Dwells) -> Screened:
    """Leave out dwells with a saturated or frozen axis.

    Raises
    ------
    DataError
        An axis gives one and the same reading in every posture.
    """
    low, high = dwells.force_min, dwells.force_max
    if len(dwells) > 1:
        stuck = (low.min(axis=0) == high.max(axis=0)) & (dwells.count.max(axis=0) > 0)[:, None]
        for i, j in np.argwhere(stuck):
            raise DataError(
                f"the {AXES[j]} axis of the sensor of {rig.supports[i]} reads "
                f"{high[0, i, j]:.6g} N in every posture: it is dead or not connected",
                where="log forces",
                hint="check the sensor, its amplifier and the force fields in rig.yaml",
            )
    reasons: dict[int, str] = {}
    over = (np.maximum(np.abs(low), np.abs(high)) >= rig.capacity) & np.isfinite(rig.capacity)
    for k, i, j in np.argwhere(over):
        reasons.setdefault(
            int(k),
            f"the {AXES[j]} axis of the sensor of {rig.supports[i]} reaches its capacity of "
            f"{rig.capacity[i, j]:.6g} N",
        )
    # One axis without any scatter, where it and the others have some elsewhere, is frozen.
    still = (low == high) & (dwells.count >= 8)[..., None]
    lively = ~still.all(axis=(0, 1, 2)) & (np.mean(~still, axis=0) > 0.5)
    for k, i, j in np.argwhere(still & lively):
        reasons.setdefault(
            int(k),
            f"the {AXES[j]} axis of the sensor of {rig.supports[i]} is frozen at "
            f"{low[k, i, j]:.6g} N",
        )
    keep = np.ones(len(dwells), dtype=bool)
    keep[list(reasons)] = False
    return Screened(keep, reasons)
