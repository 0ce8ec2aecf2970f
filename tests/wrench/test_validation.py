"""Held-out logs: false alarms, changes found and named, and how sure."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal.errors import DataError
from tdfscal.model.parameters import layout
from tdfscal.records import Dwells
from tdfscal.significance import DETECTION_POWER
from tdfscal.simulation import Faults, ZeroShift
from tdfscal.validation.residual_wrench import validate
from tests.words import in_words

from .held_out import HELD, RIG, USED, part, simulated, turned, world

TRIALS, FEWER = 100, 40
Held = Callable[[int], Dwells]


def held_of(faults: Faults | None = None, mass: float = 500.0) -> Held:
    batch = simulated(TRIALS, faults, mass)
    return lambda trial: replace(world(TRIALS), batch=batch).held(trial)


def direction(trial: int) -> np.typing.NDArray[np.float64]:
    a = np.random.default_rng(trial).standard_normal(3)
    return np.asarray(a / np.linalg.norm(a))


@pytest.mark.parametrize(
    "axis", ["any", *(pytest.param(a, marks=pytest.mark.slow) for a in ("roll", "pitch", "yaw"))]
)
def test_a_sensor_turned_by_3_mrad_is_found_and_named(axis: str) -> None:
    named, trials = 0, 8 if axis == "any" else FEWER
    for t in range(trials):
        unit = direction(t) if axis == "any" else np.eye(3)[["roll", "pitch", "yaw"].index(axis)]
        v = validate(world(TRIALS).given[t], turned(world(TRIALS), t, t % 3, 3e-3 * unit))
        named += any(c.kind == "sensor turned" and c.support == t % 3 for c in v.suspected)
    assert named >= 0.95 * trials


@pytest.mark.slow
def test_the_turn_is_estimated_with_an_honest_uncertainty() -> None:
    squares = []
    for t in range(FEWER):
        turn = 3e-3 * direction(t)
        v = validate(world(TRIALS).given[t], turned(world(TRIALS), t, t % 3, turn))
        found = next(
            c for c in v.judged.causes.best if c.kind == "sensor turned" and c.support == t % 3
        )
        squares.append(((found.value - turn) / found.std) ** 2)
    # Each component alone is χ² with one degree of freedom.
    total = np.sum(squares, axis=0)
    assert np.all(stats.chi2.cdf(total, FEWER) < 1 - 1e-4)
    assert np.all(stats.chi2.cdf(total, FEWER) > 1e-4)


@pytest.mark.slow
def test_what_is_called_detectable_is_detected_as_often_as_said() -> None:
    axis, sensor, hits = 2, 1, 0
    for t in range(FEWER):
        smallest = validate(world(TRIALS).given[t], world(TRIALS).held(t)).detectable[sensor, axis]
        v = validate(
            world(TRIALS).given[t], turned(world(TRIALS), t, sensor, smallest * np.eye(3)[axis])
        )
        hits += not v.holds
    # The search alone is counted; the test of all postures together can only add to it.
    assert stats.binom.cdf(hits, FEWER, DETECTION_POWER) > 1e-3


def test_open_parameters_cost_degrees_of_freedom_not_validity() -> None:
    place = layout(3)
    open_ = np.zeros(place["drift"].stop, dtype=np.bool_)
    open_[place["zero"]] = True
    given = replace(world(TRIALS).given[0], open=open_)
    v = validate(given, world(TRIALS).held(0))
    assert v.dof == 6 * HELD - 9
    drift = held_of(Faults(zero_shifts=(ZeroShift(1, USED, (20.0, -10.0, 30.0)),)))
    assert validate(given, drift(0)).holds
    assert not validate(world(TRIALS).given[0], drift(0)).holds


def test_no_dwell_and_no_noise_are_refused() -> None:
    held = world(TRIALS).held(0)
    with pytest.raises(DataError, match="no static dwell"):
        validate(world(TRIALS).given[0], part(held, np.zeros(0)))
    silent = replace(held, force_cov=np.zeros_like(held.force_cov))
    quiet = replace(RIG, declared=replace(RIG.declared, force_noise=0.0))
    with pytest.raises(DataError, match="force_noise"):
        validate(world(TRIALS).given[0], silent, rig=quiet)
    v = validate(world(TRIALS).given[0], silent, rig=quiet, noise=0.2)
    assert v.holds
    assert "residuals of the calibration" in in_words(v.findings)[0]
