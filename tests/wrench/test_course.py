"""What happens in the course of a check: slips, jumps and drifts are named, with their sizes."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest
from scipy import stats

from tdfscal.model.calibrated import Calibrated
from tdfscal.reporting.validation_changes import changes
from tdfscal.simulation import (
    Batch,
    Drift,
    Faults,
    Options,
    Slip,
    ZeroShift,
    simulate_dwells,
)
from tdfscal.simulation.faults import Walk, Warming
from tdfscal.validation.residual_wrench import Validation, validate

from .held_out import RIG, USED, calibrate, part

CHECKED, SLIPPED, TRIALS = 12, 6, 6
TURN = (2e-3, -1e-3, 2e-3)
FAULTS = {
    "sensor slipped": Faults(slips=(Slip(1, SLIPPED, TURN),)),
    "zero jumped": Faults(zero_shifts=(ZeroShift(1, SLIPPED, (0.6, -0.5, 0.6)),)),
    "zeros drift": Faults(drifts=(Drift(0, (10.0, -6.0, 15.0)), Drift(1, (-5.0, 8.0, 10.0)))),
    "zeros wander": Faults(walks=tuple(Walk(k, 3.0) for k in range(RIG.n))),
    "zeros follow temperature": Faults(
        warming=Warming(20.0, ((0.3, -0.2, 0.3), (-0.3, 0.1, 0.2), (0.1, 0.3, -0.3)))
    ),
}


@cache
def campaigns(postures: int, faults: Faults | None = None) -> Batch:
    """Of the same rigs, whatever the postures and the faults."""
    options = Options(postures=postures, squeeze=200.0, faults=faults or Faults())
    return simulate_dwells(RIG, options, np.random.default_rng(4), TRIALS)


@cache
def given(trial: int) -> Calibrated:
    return calibrate(RIG, campaigns(USED).dwells(trial))


@cache
def verdicts(kind: str, *, earlier: bool = False) -> tuple[Validation, ...]:
    """Checks of sound calibrations, in whose course something happens; or which it began before."""
    postures = np.arange(USED if earlier else 0, CHECKED + USED * earlier)
    batch = campaigns(CHECKED + USED * earlier, FAULTS[kind])
    return tuple(validate(given(t), part(batch.dwells(t), postures)) for t in range(TRIALS))


@pytest.mark.parametrize("kind", FAULTS)
def test_what_happens_during_a_check_is_named(kind: str) -> None:
    found = Counter(v.suspected[0].kind if v.suspected else "" for v in verdicts(kind))
    assert found[kind] >= TRIALS - 1, found


@pytest.mark.parametrize("kind", ["zeros drift", "zeros follow temperature"])
def test_a_drift_that_began_before_the_check_is_named(kind: str) -> None:
    found = Counter(
        v.suspected[0].kind if v.suspected else "" for v in verdicts(kind, earlier=True)
    )
    assert found[kind] >= TRIALS - 1, found


def test_a_slip_is_named_with_sensor_posture_and_size() -> None:
    squares, right = [], 0
    for v in verdicts("sensor slipped"):
        best = v.suspected[0]
        right += (best.support, best.postures) == (1, (SLIPPED,))
        squares.append(((best.value - TURN) / best.std) ** 2)
        assert changes(v)[0].code == "change-sensor-slipped"
    assert right >= TRIALS - 1
    assert np.all(np.abs(stats.chi2.cdf(np.sum(squares, axis=0), TRIALS) - 0.5) < 0.4999)
