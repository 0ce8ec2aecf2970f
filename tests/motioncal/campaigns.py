"""Moving campaigns of the simulator, fitted with the least of steps."""

from dataclasses import replace
from functools import cache

import numpy as np

from tdfscal.model.dynamics import Moving, voigt
from tdfscal.model.parameters import State, nominal
from tdfscal.motioncal.blocks import Block, blocks
from tdfscal.motioncal.fit import MovingState
from tdfscal.motioncal.streams import Slow, slow_streams
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
from tdfscal.simulation import reference_rig
from tdfscal.simulation.moving_campaign import MovingCampaign, simulate_moving
from tdfscal.simulation.options import MovingOptions
from tdfscal.simulation.truth import make_rig

DELAY = UncertainValue(np.array(0.0), np.array(0.02))


def played(
    options: MovingOptions, seed: int = 0, rig: Rig | None = None
) -> tuple[MovingCampaign, Slow, tuple[Block, ...]]:
    """One campaign, its slow streams and its blocks; the reference rig's are kept."""
    return _of_reference_rig(options, seed) if rig is None else _played(options, seed, rig)


@cache
def _of_reference_rig(
    options: MovingOptions, seed: int
) -> tuple[MovingCampaign, Slow, tuple[Block, ...]]:
    return _played(options, seed, reference_rig())


def _played(
    options: MovingOptions, seed: int, rig: Rig
) -> tuple[MovingCampaign, Slow, tuple[Block, ...]]:
    campaign = simulate_moving(rig, options, np.random.default_rng(seed))
    slow = slow_streams([campaign.log], rig.capacity)
    return campaign, slow, blocks(slow, np.ones(len(slow.time), dtype=np.bool_))


def perfect_rig(n: int = 3) -> Rig:
    """A rig whose NCPs stand where they say, but for what the loads bend."""
    return make_rig(n, declared=DeclaredUncertainty(positioner=0.0, hinge=0.0, force_noise=0.0))


def true_state(campaign: MovingCampaign) -> MovingState:
    """The simulator's truth as the model's state."""
    truth, rig = campaign.truth, campaign.rig

    still: State = replace(
        nominal(rig),
        rotation=truth.rotation,
        zero=truth.zero,
        mass=truth.mass,
        barycentre=truth.barycentre,
        hinge=truth.hinge,
        datum=-truth.datum,
    )
    options = campaign.options
    return MovingState(still, Moving(voigt(campaign.inertia), options.friction, options.delay))


def quiet(**changes: object) -> MovingOptions:
    """A recording without noise on carriages that hardly give."""
    stiff = {"noise": 0.0, "encoder": 0.0, "stiffness": (2e8, 2e8, 2e8)}
    return MovingOptions(**(stiff | changes))  # type: ignore[arg-type]


def turn_error(campaign: MovingCampaign, rotation: FloatArray) -> FloatArray:
    """log(X_true X̂ᵀ), (3n,), rad."""
    return so3.log(campaign.truth.rotation @ np.swapaxes(rotation, 1, 2)).ravel()


def distance(campaign: MovingCampaign, rotation: FloatArray, covariance: FloatArray) -> float:
    """d² of the turns' errors in their covariance, of as many sensors as it has."""
    error = turn_error(campaign, rotation)[: len(covariance)]
    return float(error @ np.linalg.solve(covariance, error))
