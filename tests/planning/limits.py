"""Limits to plan within."""

import numpy as np

from tdfscal.planning.candidates import Limits
from tdfscal.records import Rig


def limits(
    rig: Rig,
    *,
    tilt_deg: float = 6.0,
    squeeze: float = 200.0,
    travel: float = np.inf,
    force: float = np.inf,
    stiffness: float | None = None,
) -> Limits:
    return Limits(
        tilt=float(np.deg2rad(tilt_deg)),
        squeeze=squeeze,
        travel=np.full((rig.n, 3), travel),
        home=np.array([0.05, -0.03, 1.2]),
        force=force,
        stiffness=stiffness,
    )
