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
from tdfscal.validation.residual_wrench import AS_STATED, KnownNoise, validate
from tests.words import in_words

from .held_out import HELD, RIG, USED, part, simulated, turned, world

TRIALS, FEWER = 100, 40
Held = Callable[[int], Dwells]


def held_of(faults: Faults | None = None, mass: float = 500.0) -> Held:
    batch = simulated(TRIALS, faults, mass)
    return lambda trial: replace(world(TRIALS), batch=batch).held(trial)


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


def test_a_level_from_residuals_widens_the_tail_as_few_of_them_do() -> None:
    rng, dof, freedom = np.random.default_rng(1), 30, 12
    ratio = rng.chisquare(freedom, 200_000) / (rng.chisquare(dof, 200_000) / dof)
    known = KnownNoise(1.5, dof)
    for edge in (20.0, 30.0):
        assert known.chi2_sf(edge, freedom) == pytest.approx(np.mean(ratio > edge), rel=0.1)
        assert AS_STATED.chi2_sf(edge, freedom) < known.chi2_sf(edge, freedom)
