"""Clocks of two recorders, against those with which simulated campaigns were written."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri

from tdfscal.clocks import find_clock
from tdfscal.clocks.tracks import Reduction, Tracks
from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.records import ClockPrior, Log, Series, UncertainValue
from tdfscal.simulation import MOVING, Options, Recorder, reference_rig, run
from tests.cli.apart import Apart, recorded_apart
from tests.words import refusal


def campaign(scenario: str, seed: int) -> Log:
    recorder = Recorder(force_rate=100.0, position_rate=100.0)
    options = MOVING.get(scenario) or Options(postures=12, squeeze=200.0, recorder=recorder)
    played = run(reference_rig(), scenario, options, np.random.default_rng(seed))
    recorded = played.campaign or played.moving
    assert recorded is not None
    return recorded.log


def tracks(log: Log) -> Tracks:
    reduction = Reduction()
    reduction.add([s for pair in zip(log.position, log.force, strict=True) for s in pair])
    return reduction.finish()


def found(log: Log, how: Apart, prior: ClockPrior | None = None) -> tuple[float, float]:
    """Error of the offset, s, and its standard uncertainty."""
    moves, loads = recorded_apart(log, how, np.random.default_rng(1))
    clock = find_clock(tracks(moves), tracks(loads), prior or ClockPrior(), "daq")
    return clock.offset - how.offset, clock.offset_std


@pytest.mark.parametrize("offset", [-81234.5, 1.8e9])
def test_any_offset_is_found_at_rest(offset: float) -> None:
    error, std = found(campaign("self", 3), Apart(offset, 30e-6, late=2.0, jitter=1e-3))
    assert abs(error) < 3.0 * std < 0.1


def pulls(log: Log, rate: float, late: float, forces_first: bool) -> tuple[float, float]:
    """Errors of offset and rate in standard uncertainties."""
    how = Apart(3.7, rate, late=0.0 if forces_first else 2.0, position_rate=50.0, force_rate=20.0)
    moves, loads = recorded_apart(log, how, np.random.default_rng(1))
    first, second = (loads, moves) if forces_first else (moves, loads)
    clock = find_clock(tracks(first), tracks(second), ClockPrior(), "other")
    begin, rate_back = float(moves.position[0].time[0]), 1.0 / (1.0 + rate) - 1.0
    true = 3.7 + late, rate
    if forces_first:
        # Of the positions' clock at the forces' first stamp, which is `begin` of the positions'.
        true = begin - float(loads.force[0].time[0]) - late, rate_back
    offset = (clock.offset - true[0]) / clock.offset_std
    return offset, (clock.rate - true[1]) / clock.rate_std


@pytest.mark.parametrize("forces_first", [False, True])
def test_stated_uncertainties_are_those_of_the_errors(forces_first: bool) -> None:
    """Of slow and fast moves, and of motion whose forces are 5 ms late besides."""
    z = []
    for seed, rate in enumerate([0.0, 1e-4, -1e-4] * 2):
        move = [(0.5, 1.0), (2.0, 4.0)][seed % 2]
        recorder = Recorder(dwell=(2.0, 3.0), move=move)
        options = Options(postures=16, squeeze=200.0, recorder=recorder)
        played = run(reference_rig(), "self", options, np.random.default_rng(40 + seed)).campaign
        assert played is not None
        z.append(pulls(played.log, rate, 0.0, forces_first))
    z.append(pulls(campaign("motion", 5), 0.0, 0.005, forces_first))
    square = np.square(z)
    assert square.max() < 4.0**2
    assert (square.sum(axis=0) < chdtri(len(z), 1e-3)).all()


def recorded(log: Log, begin: float, end: float) -> Log:
    """What a recorder wrote from one time to another, s."""

    def part(series: Series) -> Series:
        kept = (series.time >= begin) & (series.time < end)
        return Series(series.time[kept], series.value[kept])

    return replace(log, position=tuple(map(part, log.position)), force=tuple(map(part, log.force)))


def test_a_motion_without_rests() -> None:
    """Active all the time; the moves then allow no lag near the true one, but the balance does."""
    options = replace(MOVING["motion"], duration=90.0, frequency=0.04, rate=50.0)
    moving = run(reference_rig(), "motion", options, np.random.default_rng(4)).moving
    assert moving is not None
    error, std = found(recorded(moving.log, 6.0, 84.0), Apart(-21.3, 5e-5, late=2.0))
    assert abs(error - 0.005) < 3.0 * std < 0.03


@pytest.mark.parametrize("scenario", ["self", "motion"])
@pytest.mark.parametrize("wrong", ["sign", "two signs", "sensors", "place"])
def test_wrong_wiring_leaves_the_clock(scenario: str, wrong: str) -> None:
    """No lag balances then; by the clock that holds without the mistake the log itself tells it."""
    log = campaign(scenario, 5)
    position, force = ([s.value.copy() for s in kind] for kind in (log.position, log.force))
    if "sign" in wrong:
        force[0][:, 0] *= -1.0
        force[2][:, 1] *= -1.0 if wrong == "two signs" else 1.0
    elif wrong == "sensors":
        force[0], force[2] = force[2], force[0]
    else:
        position[1][:, 1] *= -1.0
    miswired = replace(
        log,
        position=tuple(map(Series, (s.time for s in log.position), position)),
        force=tuple(map(Series, (s.time for s in log.force), force)),
    )
    error, std = found(miswired, Apart(3.7, late=1.0))
    assert abs(error - 0.005 * (scenario == "motion")) < 3.0 * std < 0.05


def test_a_campaign_that_repeats_itself_is_not_decided() -> None:
    log = campaign("self", 4)
    span = float(log.force[0].time[-1]) + 0.01

    def twice(series: Series) -> Series:
        return Series(
            np.concatenate([series.time, series.time + span]),
            np.concatenate([series.value, series.value]),
        )

    again = replace(
        log, position=tuple(map(twice, log.position)), force=tuple(map(twice, log.force))
    )
    moves, loads = recorded_apart(again, Apart(5.0), np.random.default_rng(1))
    with pytest.raises(NotIdentifiableError) as refused:
        find_clock(tracks(moves), tracks(loads), ClockPrior(), "daq")
    assert refused.value.exit_status == 4
    assert refused.value.finding.code == "recorder-clock-open"
    clock = find_clock(tracks(moves), tracks(loads), stated(5.2, 0.5), "daq")
    assert abs(clock.offset - 5.0) < 3.0 * clock.offset_std


def test_recordings_of_different_campaigns_are_refused() -> None:
    moves, _ = recorded_apart(campaign("self", 5), Apart(), np.random.default_rng(1))
    _, loads = recorded_apart(campaign("self", 6), Apart(), np.random.default_rng(1))
    found = refusal(find_clock, tracks(moves), tracks(loads), ClockPrior(), "daq")
    assert found.code == "recorder-not-found"
    # Of other times, and their moves tell nothing.
    found = refusal(find_clock, tracks(moves), tracks(loads), stated(5000.0, 0.5), "daq")
    assert found.code == "recorders-overlap-nowhere"
    assert "likelier" not in found.values


def test_a_stated_clock_is_believed_where_a_channel_is_missing() -> None:
    """In motion no activity tells the lag then, and the statement stays as good as it was."""
    moves, loads = recorded_apart(campaign("motion", 3), Apart(3.7), np.random.default_rng(1))
    dead = Series(loads.force[1].time, loads.force[1].value * [0.0, 1.0, 1.0])
    part = tracks(replace(loads, force=(loads.force[0], dead, *loads.force[2:])))
    with pytest.raises(DataError):
        find_clock(tracks(moves), part, ClockPrior(), "daq")
    clock = find_clock(tracks(moves), part, stated(3.73, 0.05), "daq")
    assert clock.offset == pytest.approx(3.73, abs=1e-3)
    assert clock.offset_std == pytest.approx(0.05, rel=1e-2)


@pytest.mark.parametrize(("scenario", "seed"), [("self", 5), ("stops", 4)])
def test_values_in_the_reverse_order_of_their_times_are_refused(scenario: str, seed: int) -> None:
    """Even where stops that follow each other evenly are alike at several lags."""
    moves, loads = recorded_apart(campaign(scenario, seed), Apart(3.7), np.random.default_rng(1))
    turned = tuple(Series(s.time, np.ascontiguousarray(s.value[::-1])) for s in loads.force)
    with pytest.raises((DataError, NotIdentifiableError)):
        find_clock(tracks(moves), tracks(replace(loads, force=turned)), ClockPrior(), "daq")


@pytest.mark.parametrize(("seed", "which"), [(4, 0), (5, 1)])
def test_one_recorder_that_ended_early_is_found_by_half_of_the_moves(seed: int, which: int) -> None:
    both = list(recorded_apart(campaign("self", seed), Apart(3.7), np.random.default_rng(1)))
    series = (both[0].position, both[1].force)[which][0]
    both[which] = recorded(both[which], -np.inf, float(series.time[0] + 0.52 * np.ptp(series.time)))
    clock = find_clock(tracks(both[0]), tracks(both[1]), ClockPrior(), "daq")
    assert abs(clock.offset - 3.7) < 3.0 * clock.offset_std < 0.3


def test_a_recorder_with_too_few_moves_is_refused_with_what_each_lasts() -> None:
    moves, loads = recorded_apart(campaign("self", 5), Apart(3.7), np.random.default_rng(1))
    begin = float(moves.position[0].time[0])
    part = tracks(recorded(moves, begin, begin + 15.0))
    found = refusal(find_clock, part, tracks(loads), ClockPrior(), "daq")
    assert (found.code, found.values["short"]) == ("recorder-not-found", True)
    assert found.values["first"] == pytest.approx(15.0, abs=0.05)
    assert found.values["second"] == pytest.approx(np.ptp(loads.force[0].time), abs=0.05)


@pytest.fixture(scope="module")
def pair() -> tuple[Tracks, Tracks]:
    """Two recorders of one campaign, the second's stamps 81234.5 s less than the first's."""
    how = Apart(-81234.5, 30e-6)
    moves, loads = recorded_apart(campaign("self", 5), how, np.random.default_rng(1))
    return tracks(moves), tracks(loads)


def stated(offset: float, std: float, rate_std: float = 1e-4) -> ClockPrior:
    return ClockPrior(UncertainValue(np.array(offset), np.array(std)), rate_std)


@pytest.mark.parametrize(("off", "std", "rate_std"), [(2 * 81234.5, 0.0, 1e-4), (-1e3, 0.5, 0.0)])
def test_a_stated_offset_by_which_recorders_do_not_overlap_is_refused(
    pair: tuple[Tracks, Tracks], off: float, std: float, rate_std: float
) -> None:
    """What their moves say instead is told, and whether it is but the sign."""
    found = refusal(find_clock, *pair, stated(off - 81234.5, std, rate_std), "daq")
    assert found.code == "recorders-overlap-nowhere"
    assert found.values["likelier"] == pytest.approx(-81234.5, abs=0.3)
    assert found.values["reversed"] is (off == 2.0 * 81234.5)
    assert found.values["begin"] == pytest.approx(-off, abs=0.1)


@pytest.mark.parametrize("off", [-30.0, 3.5])
def test_a_contradicted_offset_is_refused(pair: tuple[Tracks, Tracks], off: float) -> None:
    found = refusal(find_clock, *pair, stated(off - 81234.5, 0.5), "daq")
    assert found.code == "recorder-clock-misstated"
    assert found.values["likelier"] == pytest.approx(-81234.5, abs=0.3)


@pytest.mark.parametrize(("off", "rate_std"), [(-1.0, 0.0), (1.0, 1e-3)])
def test_a_stated_offset_is_mended(
    pair: tuple[Tracks, Tracks], off: float, rate_std: float
) -> None:
    clock = find_clock(*pair, stated(off - 81234.5, 0.5, rate_std), "daq")
    assert abs(clock.offset + 81234.5) < 3.0 * clock.offset_std
