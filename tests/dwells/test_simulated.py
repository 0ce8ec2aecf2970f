"""Dwells of simulated campaigns: the simulator's truth, its own settling, vibration and moves."""

import numpy as np
import pytest
from scipy.stats import poisson

from tdfscal.dwells import find_dwells
from tdfscal.dwells.field import segment
from tdfscal.dwells.noise_level import Signals
from tdfscal.significance import LEVEL_CHANGES_PER_LOG
from tdfscal.simulation import Options, Recorder, reference_rig, run


def test_a_change_of_level_that_no_reading_shows_is_none() -> None:
    """Windows as long as half a stop differ here by chance, by more than their noise as found."""
    recorder = Recorder(force_rate=30.0, position_rate=30.0)
    options = Options(postures=16, squeeze=200.0, recorder=recorder)
    played = run(reference_rig(), "self", options, np.random.default_rng(21)).campaign
    assert played is not None
    dwells = find_dwells(played.log)
    assert len(dwells) == 16
    assert not dwells.left_out
    assert not dwells.findings


@pytest.mark.parametrize(("stops", "length"), [(4, 68), (8, 66)])
def test_noise_of_which_a_log_shows_little_is_no_change_of_level(stops: int, length: int) -> None:
    """White noise of stops hardly longer than the two longest windows, in bins."""
    base = np.tile(np.arange(length + 4) >= length, stops)
    false = 0
    for seed in range(100):
        value = np.random.default_rng(seed).standard_normal((9, len(base)))
        marked, _ = segment(Signals(value, base, np.zeros(9)), base, 0.02)
        false += bool((marked & ~base).any())
    assert false <= poisson.ppf(0.999, 100 * LEVEL_CHANGES_PER_LOG)
