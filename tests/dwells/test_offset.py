"""The offset between the clocks of positions and forces, put into simulated campaigns."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.dwells import dwells_of_bins, misaligned, motion_offset, reduce_to_bins
from tdfscal.records import Log, Series
from tdfscal.simulation import Options, Recorder, reference_rig, simulate_campaign
from tests.words import in_words


@pytest.fixture(scope="module")
def log() -> Log:
    options = Options(postures=24, recorder=Recorder(force_rate=200.0))
    return simulate_campaign(reference_rig(), options, np.random.default_rng(3)).log


@pytest.mark.parametrize("delay", [0.0, -0.15])
def test_a_delay_of_the_forces_is_found(log: Log, delay: float) -> None:
    late = replace(log, force=tuple(Series(s.time + delay, s.value) for s in log.force))
    bins = reduce_to_bins([late])
    dwells = dwells_of_bins(bins)
    offset = motion_offset(bins, dwells)
    assert offset is not None
    assert offset.std < 0.01
    assert abs(offset.seconds - delay) < 4.0 * offset.std
    assert offset.large == (delay != 0.0)
    assert any("clocks: the forces follow" in w for w in in_words(dwells.findings)) == (
        delay != 0.0
    )


@pytest.mark.parametrize("rate", [2e-3, -1.5e-3])
def test_clocks_that_run_apart_are_told_by_their_rate(log: Log, rate: float) -> None:
    late = replace(log, force=tuple(Series(s.time * (1 + rate), s.value) for s in log.force))
    bins = reduce_to_bins([late])
    dwells = dwells_of_bins(bins)
    offset = motion_offset(bins, dwells)
    assert offset is not None
    assert abs(offset.rate - rate) < 4.0 * offset.rate_std < 1e-3
    middle = (dwells.end[0] + dwells.start[-1]) / 2
    assert abs(offset.seconds - rate * middle) < 4.0 * offset.std
    assert offset.large
    assert offset.running
    assert any("run apart by" in w for w in in_words(dwells.findings))


@pytest.mark.parametrize("late", [7.0, -7.0])
def test_forces_a_whole_cycle_behind_are_told(late: float) -> None:
    """Where all stops and moves are alike, the moves fall together at that lag too."""
    recorder = Recorder(dwell=(4.0, 4.0), move=(3.0, 3.0))
    options = Options(postures=16, squeeze=200.0, recorder=recorder)
    log = simulate_campaign(reference_rig(), options, np.random.default_rng(3)).log
    moved = replace(log, force=tuple(Series(s.time + late, s.value) for s in log.force))
    bins = reduce_to_bins([moved])
    found = misaligned(bins, dwells_of_bins(bins))
    assert found is not None
    assert found.size == pytest.approx(7.0, abs=0.1)
    assert found.values["late"] == (late > 0)
    sound = reduce_to_bins([log])
    assert misaligned(sound, dwells_of_bins(sound)) is None
