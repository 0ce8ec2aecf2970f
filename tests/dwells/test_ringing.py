"""What rings alike after every move, however slowly."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.dwells import find_dwells, reduce_to_bins
from tdfscal.dwells.field import prepare
from tdfscal.dwells.ringing import Ringing

from .rig_log import Recipe, record


def mode_of(recipe: Recipe) -> Ringing | None:
    return prepare(reduce_to_bins([record(recipe).log])).ringing


@pytest.mark.parametrize(
    ("tau", "frequency", "stop"),
    [
        (2.0, 0.5, 1.5),
        (2.0, 0.5, 8.0),
        (0.4, 0.5, 4.0),
        (0.5, 2.5, 4.0),
        (0.2, 8.0, 2.0),
        (0.8, 0.0, 6.0),
    ],
)
def test_the_mode_is_found_with_its_constants(tau: float, frequency: float, stop: float) -> None:
    """Also where no stop shows a whole period."""
    mode = mode_of(Recipe(settle=(10.0, tau, frequency), stops=(stop,) * 12, seed=3))
    assert mode is not None
    assert mode.frequency == pytest.approx(frequency, rel=0.06, abs=0.0 if frequency else 0.03)
    assert mode.constant == pytest.approx(tau, rel=0.06)
    # Amplitudes are drawn from 5 to 10 N: 7.64 N rms.
    assert np.sqrt(mode.power.mean()) == pytest.approx(7.64, rel=0.1)


@pytest.mark.parametrize(("tau", "frequency", "stop"), [(0.4, 0.5, 4.0), (0.2, 0.0, 6.0)])
def test_wrong_readings_in_a_few_stops_are_no_mode(
    tau: float, frequency: float, stop: float
) -> None:
    recorded = record(Recipe(settle=(10.0, tau, frequency), stops=(stop,) * 12, seed=3))
    series = recorded.log.force[0]
    for begin, end in recorded.stops[[1, 5]]:
        first = np.searchsorted(series.time, begin + 0.8 * (end - begin))
        series.value[first : first + 3, 0] = 9999.0
    assert len(find_dwells(recorded.log)) == 12


@pytest.mark.slow
@pytest.mark.parametrize(
    "recipe",
    [
        Recipe(),
        Recipe(force_tau=0.1, stops=(6.0,) * 12),
        Recipe(force_tau=0.4, stops=(10.0,) * 12),
        Recipe(vibration=(5.0, 1e-7, 0.5), stops=(8.0,) * 12),
        Recipe(vibration=(5.0, 1e-7, 5.0), stops=(3.0,) * 12),
        Recipe(drift=0.3, stops=(5.0,) * 12),
    ],
    ids=["white", "0.1 s", "0.4 s", "0.5 Hz", "5 Hz", "drift"],
)
def test_noise_vibration_and_drift_are_no_mode(recipe: Recipe) -> None:
    assert [mode_of(replace(recipe, seed=seed)) for seed in range(5)] == [None] * 5


@pytest.mark.parametrize(("stop", "amplitude"), [(1.5, 30.0), (1.5, 1.0), (3.0, 5.0)])
def test_no_crest_of_slow_ringing_is_a_dwell(stop: float, amplitude: float) -> None:
    dwells = find_dwells(record(Recipe(settle=(amplitude, 2.0, 0.5), stops=(stop,) * 12)).log)
    assert len(dwells) == 0
    assert len(dwells.left_out) >= 12
    seen = [out.reason.values["frequency"] for out in dwells.left_out if out.reason.values]
    assert 0.5 in [pytest.approx(hertz, abs=0.1) for hertz in seen]
