"""What the moves between dwells would add: the uncertainty of rests and moves in one estimate."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.estimation.fit import information
from tdfscal.model.parameters import State
from tdfscal.motioncal.checks import usable_samples
from tdfscal.motioncal.estimator import MovingPriors, at_state, estimate_noise
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig, UncertainValue

#: Blocks of a long log that are looked at.
_FEW = 4


def with_moves(rig: Rig, slow: Slow, delay: UncertainValue, still: State) -> FloatArray | None:
    """Standard uncertainties (n, 3) of roll, pitch, yaw to expect from the whole log, rad.

    One linearisation at the estimate from the dwells, and the spectrum of what it leaves: no
    iteration, and nothing for what that spectrum leaves open, which is little wherever the moves
    tell much. Of a long log some blocks are looked at, and the rest taken to tell as much.

    still : the estimate from the dwells. Returns None where the log does not serve in motion.
    """
    try:
        blocks = usable_samples(rig, slow).blocks
        few = blocks[:: -(-len(blocks) // _FEW)]
        priors = MovingPriors(rig, slow, delay)
        fit = estimate_noise(at_state(priors, few, priors.start(still), None))
        turns = information(fit).root[: 3 * rig.n]
        std = np.sqrt(so3.rpy_variance(still.rotation, turns @ turns.T))
    except (TdfscalError, np.linalg.LinAlgError):
        return None
    seen, whole = (sum(block.seconds for block in part) for part in (few, blocks))
    return std * float(np.sqrt(seen / whole))
