"""Small machines under control."""

import numpy as np

from tdfscal.records import FloatArray
from tdfscal.simulation import Options, Pose, Truth, draw_truths
from tests.simulation.rigs import exact_rig, loose_rig

HOME = np.array([0.05, -0.03, 1.2])


def truths(lanes: int, *, loose: bool = True, seed: int = 0) -> Truth:
    rig = loose_rig() if loose else exact_rig()
    return draw_truths(rig, Options(), np.random.default_rng(seed), lanes)


def poses(lanes: int, shift: FloatArray | None = None, turn: FloatArray | None = None) -> Pose:
    R = np.eye(3) if turn is None else turn
    T = HOME + (np.zeros(3) if shift is None else shift)
    return Pose(
        np.array(np.broadcast_to(R, (lanes, 3, 3))), np.array(np.broadcast_to(T, (lanes, 3)))
    )
