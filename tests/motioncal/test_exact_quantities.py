"""What is taken as exact in motion, against a fit of a rig file that is wrong by as much."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.estimation.exact_quantities import exact_quantities
from tdfscal.estimation.fit import information
from tdfscal.motioncal.estimator import fit_moving
from tdfscal.motioncal.fit import MovingPriors, MovingState
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, UncertainValue
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import played, true_state


def exactly(value: float | FloatArray) -> UncertainValue:
    return UncertainValue(np.asarray(value), np.zeros(np.shape(value)))


@pytest.mark.parametrize("name", ["mass", "barycentre", "delay"])
def test_a_wrong_exact_value_turns_the_sensors_as_foretold(name: str) -> None:
    campaign, slow, cut = played(MovingOptions(rate=100.0, duration=40.0), 3)
    state, rig = true_state(campaign), campaign.rig
    delay = exactly(0.005)
    rig = replace(rig, mass=exactly(state.still.mass), barycentre=exactly(state.still.barycentre))

    def turned(start: MovingState, delay: UncertainValue) -> FloatArray:
        fit = fit_moving(MovingPriors(rig, slow, delay), cut, start, right.noise)
        return so3.log(
            fit.state.still.rotation @ np.swapaxes(right.state.still.rotation, 1, 2)
        ).ravel()

    right = fit_moving(MovingPriors(rig, slow, delay), cut, state)
    found = {quantity.name: quantity for quantity in exact_quantities(right, information(right))}
    assert {"base level", "mass", "barycentre", "delay"} <= set(found)
    quantity = found[name]
    error = quantity.error
    wrong = state
    if name == "mass":
        less = state.still.mass * (1 - error)
        wrong = replace(state, still=replace(state.still, mass=less))
    elif name == "barycentre":
        moved = state.still.barycentre - error * np.array([0.0, 1.0, 0.0])
        wrong = replace(state, still=replace(state.still, barycentre=moved))
    else:
        delay = exactly(0.005 - error)
        wrong = replace(state, moving=replace(state.moving, delay=0.005 - error))
    seen = turned(wrong, delay)
    expected = quantity.turns(3)[:, 1 if name == "barycentre" else 0]
    # The error is true less stated; the turn is that of what is found. A wrong delay raises the
    # spectrum as well, which the prediction does not.
    assert np.linalg.norm(seen - expected) < 0.25 * np.linalg.norm(expected)
