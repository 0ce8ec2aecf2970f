"""The offset between the clocks of positions and forces, put into simulated campaigns."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.checks.faulty_sensors import screen
from tdfscal.dwells import (
    dwells_of_bins,
    is_large,
    misaligned,
    motion_offset,
    reduce_to_bins,
    with_offset,
)
from tdfscal.dwells.clock_offset import forces_behind
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
    assert is_large(offset) == (delay != 0.0)
    said = in_words(with_offset(dwells, offset).findings)
    assert any("clocks: the forces follow" in w for w in said) == (delay != 0.0)


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
    assert is_large(offset)
    assert any("run apart by" in w for w in in_words(with_offset(dwells, offset).findings))


@pytest.mark.parametrize("late", [7.0, -7.0])
def test_forces_a_whole_cycle_behind_are_told(late: float) -> None:
    """Where all stops and moves are alike, the moves fall together at that lag too."""
    recorder = Recorder(dwell=(4.0, 4.0), move=(3.0, 3.0))
    options = Options(postures=16, squeeze=200.0, recorder=recorder)
    log = simulate_campaign(reference_rig(), options, np.random.default_rng(3)).log
    moved = replace(log, force=tuple(Series(s.time + late, s.value) for s in log.force))
    bins = reduce_to_bins([moved])
    found = misaligned(bins, dwells_of_bins(bins), None)
    assert found is not None
    assert found.size == pytest.approx(7.0, abs=0.1)
    assert found.values["late"] == (late > 0)
    sound = reduce_to_bins([log])
    assert misaligned(sound, dwells_of_bins(sound), None) is None


def _dropped(log: Log, drops: list[tuple[int, int, float, float, float]]) -> Log:
    """The log with forces at a reading, N, for some time: support, axis, begin, end, reading."""
    force = [Series(s.time, s.value.copy()) for s in log.force]
    for i, axis, begin, end, reading in drops:
        force[i].value[(force[i].time >= begin) & (force[i].time < end), axis] = reading
    return replace(log, force=tuple(force))


@pytest.fixture(scope="module")
def driven() -> Log:
    return simulate_campaign(reference_rig(), Options(), np.random.default_rng(5)).log


DROPS: dict[str, list[tuple[int, int, float, float, float]]] = {
    "vertical": [(0, 2, 50.0, 53.0, 0.0)],
    "beyond all": [(1, 0, 50.0, 53.0, 1e9)],
    "negative": [(2, 1, 50.0, 53.0, -9e3)],
    "two stops": [(0, 2, 90.0, 98.0, 0.0)],
    "brief": [(0, 2, 50.0, 50.4, 3e4)],
    "several": [(0, 2, 50.0, 53.0, 0.0), (1, 1, 90.0, 94.0, 0.0), (2, 2, 120.0, 126.0, 0.0)],
}


@pytest.mark.parametrize("drops", DROPS.values(), ids=DROPS.keys())
def test_a_channel_that_drops_out_costs_its_own_stops(
    driven: Log, drops: list[tuple[int, int, float, float, float]]
) -> None:
    """No mode of all stops, no lag of the clocks."""
    sound = dwells_of_bins(reduce_to_bins([driven]))
    bins = reduce_to_bins([_dropped(driven, drops)])
    found = dwells_of_bins(bins)
    assert misaligned(bins, found, motion_offset(bins, found)) is None
    away = [all(b < begin or a > end for *_, begin, end, _ in drops)
            for a, b in zip(sound.start, sound.end, strict=True)]  # fmt: skip
    kept = screen(reference_rig(), found).keep
    middle = 0.5 * (sound.start + sound.end)[away]
    inside = (found.start < middle[:, None]) & (middle[:, None] < found.end) & kept
    assert inside.any(axis=1).all()


def test_no_lag_passes_a_drop_by(driven: Log) -> None:
    """At a lag that pairs only what the drop spares, the forces' own time balances too."""
    bins = reduce_to_bins([_dropped(driven, [(0, 2, 50.0, 53.0, 0.0)])])
    assert forces_behind(bins.start, bins.mean[:, :3], bins.mean[:, 3:]) is None
