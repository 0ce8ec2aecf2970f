"""What a rig file does not say shows in a motion's residual, and is named."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.estimation.score_tests import Suspicion
from tdfscal.estimation.uncertainty import UNDECLARED, estimate
from tdfscal.model.parameters import layout
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Drift, FloatArray, Log, Rig, Series, UncertainValue
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, distance, played, turn_error
from tests.words import in_words, refusal

MINUTE = MovingOptions(rate=100.0, noise=1.1, slow_noise=0.3, stiffness=(2e8, 2e8, 2e8))


def doubts(change: str) -> tuple[Suspicion, ...]:
    """Suspicions of one minute whose second sensor, or whose rig file, is changed."""
    campaign, _, _ = played(MINUTE, 21)
    rig: Rig = campaign.rig
    time, value = campaign.log.force[1].time, campaign.log.force[1].value
    if change == "mass":
        rig = replace(rig, mass=UncertainValue(rig.mass.value + 2.0, rig.mass.std))
    elif change == "gain":
        value = 1.01 * value
    elif change == "drift":
        course: FloatArray = time / time[-1]
        value = value + np.outer(course, [3.0, -2.0, 4.0])
    force = (campaign.log.force[0], Series(time, value), campaign.log.force[2])
    log = Log(campaign.log.supports, campaign.log.position, force)
    return calibrate_moving(rig, slow_streams([log], rig.capacity), DELAY).suspicions


@pytest.mark.parametrize(
    ("change", "support"),
    [
        ("gain", 1),
        *(pytest.param(*v, marks=pytest.mark.slow) for v in (("mass", None), ("drift", 1))),
    ],
    ids=lambda v: str(v),
)
def test_what_is_not_stated_is_named(change: str, support: int | None) -> None:
    first = doubts(change)[0]
    assert (first.kind, first.support) == (change, support)


def test_an_uncertain_suspicion_stands_in_the_uncertainty() -> None:
    """A gain 0.3 % wrong in one approach: not sure enough to reject, and 3.6 σ of a turn."""
    options = replace(MovingOptions.approach(), rate=100.0, noise=1.1)
    campaign, slow, _ = played(options, 4)
    force = slow.force.copy()
    force[:, 1] *= 1.003
    rng = np.random.default_rng(1)
    result = calibrate_moving(campaign.rig, replace(slow, force=force), DELAY, rng=rng)
    doubt = result.suspicions[0]
    assert (doubt.kind, doubt.support, doubt.spoils(moving=True)) == ("gain", 1, False)
    assert doubt.shift > 2.0
    error, turns = turn_error(campaign, result.fit.state.still.rotation), result.uncertainty
    silent = np.sqrt(np.diagonal(estimate(result.fit).uncertainty.covariance))
    assert np.mean(np.abs(error) < 1.96 * silent) < 0.8
    assert np.all(np.abs(error) < 1.96 * np.sqrt(np.diagonal(turns.covariance)))
    assert turns.contributions[UNDECLARED].max() > 0.5 * turns.rpy_std.max() ** 2
    assert any(finding.values.get("held") for finding in result.findings)
    assert result.monte_carlo is not None
    assert result.monte_carlo.std == pytest.approx(turns.rpy_std, rel=0.1)


@pytest.mark.slow
def test_zeros_that_follow_the_temperature_are_found_and_followed() -> None:
    """A hall that warms by 10 K and cools again; the truth moves the second sensor's zero."""
    campaign, slow, _ = played(MINUTE, 21)
    warmth = 10.0 * np.sin(np.pi * slow.time / slow.time[-1])
    slope = np.array([0.8, -0.6, 1.0])
    force = slow.force.copy()
    force[:, 1] += np.outer(warmth, slope)
    warm = replace(slow, force=force, temperature=np.repeat(20.0 + warmth[:, None], 3, axis=1))
    asked = calibrate_moving(campaign.rig, warm, DELAY).suspicions
    assert (asked[0].kind, asked[0].support) == ("temperature", 1)
    declared = replace(campaign.rig, drift=Drift(temperature=1.0))
    result = calibrate_moving(declared, warm, DELAY)
    assert result.suspicions == ()
    std = result.uncertainty.parameter_std[layout(3, 1)["drift"]].reshape(3, 3)
    assert np.all(np.abs(result.fit.state.still.drift[0, 1] - slope) < 4 * std[1])
    rotation, covariance = result.fit.state.still.rotation, result.uncertainty.covariance
    assert distance(campaign, rotation, covariance) < chi2_quantile(1 - 1e-3, 9)
    assert refusal(calibrate_moving, declared, slow, DELAY).code == "temperature-missing"


@pytest.mark.parametrize("change", ["hinge", "datum"])
def test_a_wrong_geometry_is_named_before_its_echoes(change: str) -> None:
    """A hinge of the rig file 2 mm off in its plane, or 1 mm of a positioner's datum."""
    campaign, slow, _ = played(MINUTE, 21)
    rig, position = campaign.rig, slow.position.copy()
    if change == "hinge":
        hinge = rig.hinge.copy()
        hinge[0] += [1.2e-3, -1.6e-3, 0.0]
        rig = replace(rig, hinge=hinge)
    else:
        position[:, 0] += [0.6e-3, 0.0, 0.8e-3]
    found = calibrate_moving(rig, replace(slow, position=position), DELAY)
    first = found.suspicions[0]
    assert (first.kind, first.support) == (change, 0)
    assert any("distances between hinges" in reason for reason in in_words(found.reasons))
