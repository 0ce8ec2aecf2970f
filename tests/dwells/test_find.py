"""Dwells found on logs whose stops are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.dwell_stops import Score
from benchmarks.dwell_stops import score as score_of
from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.records import Dwells, FloatArray, Log, Series

from .rig_log import Recipe, Recorded, record

STOPS = (4.0,) * 8


def score(recorded: Recorded, dwells: Dwells) -> Score:
    """Every stop is one dwell, which reaches into no move, and no settling biases it."""
    found = score_of(recorded, dwells)
    count = len(recorded.stops)
    assert (found.found, found.parts, found.astray) == (count, 0, 0)
    assert found.bias.max() < 1.0
    assert np.all(np.diff(dwells.start) > 0)
    return found


def settling(amplitude: float, tau: float, hertz: float, stop: float, count: int) -> Recipe:
    return Recipe(settle=(amplitude, tau, hertz), stops=(stop,) * count)


RANGE = {
    "1 kHz": Recipe(rate=1000, stops=STOPS),
    "forces 200 Hz, positions 50 Hz": Recipe(rate=200, position_rate=50, stops=STOPS),
    "jitter": Recipe(rate=500, position_rate=50, jitter=0.9, stops=STOPS),
    "four supports": Recipe(supports=4, stops=STOPS),
    "stops of 0.5 s at 50 Hz, 3 µm": Recipe(rate=50, position_noise=3e-6, stops=(0.5,) * 30),
    "stops of all lengths": Recipe(rate=100, stops=(0.5, 60.0, 1.0, 5.0, 120.0, 0.7, 20.0)),
    "constant encoders": Recipe(position_noise=0, quantum=1e-6, stops=STOPS),
    "toggling encoders": Recipe(position_noise=0.2e-6, quantum=1e-6, stops=STOPS),
    "no noise at all": Recipe(position_noise=0, force_noise=0, stops=STOPS),
    "rounded forces": Recipe(force_quantum=1.0, force_noise=0.2, stops=STOPS),
    "vibration 50 Hz": Recipe(rate=500, vibration=(3.0, 0.1e-6, 50.0), stops=STOPS),
    "squeeze 3 µm, noise 1 µm": Recipe(
        travel=3e-6, move=0.4, stiffness=2e7, stops=(2.0,) * 20, position_noise=1e-6
    ),
    "squeeze by a step, 50 Hz": Recipe(
        rate=50, travel=4e-6, move=0.04, stiffness=2e7, stops=(1.0,) * 20, position_noise=1e-6
    ),
    "correlated noise": Recipe(force_tau=0.05, rate=500, stops=STOPS),
    "drift of -0.5 N/s": Recipe(drift=-0.5, stops=(4.0,) * 12),
    "settling of 0.5 s": settling(30.0, 0.5, 0.0, 5.5, 10),
    "settling of 3 s": settling(30.0, 3.0, 0.0, 27.0, 6),
    "ringing at 0.5 Hz": settling(1.0, 2.0, 0.5, 20.0, 10),
    "ringing at 1 Hz, 30 N": settling(30.0, 0.5, 1.0, 4.5, 6),
    "ringing at 8 Hz": settling(1.0, 0.2, 8.0, 1.8, 6),
    "two modes": replace(settling(30.0, 0.3, 0.0, 5.0, 10), also=(30.0, 0.6, 4.0)),
    "two that ring": replace(settling(30.0, 0.5, 3.0, 9.0, 10), also=(30.0, 1.0, 0.7)),
}


@pytest.mark.parametrize("recipe", RANGE.values(), ids=RANGE.keys())
def test_every_stop_is_one_dwell(recipe: Recipe) -> None:
    recorded = record(replace(recipe, seed=len(recipe.stops)))
    dwells = find_dwells(recorded.log)
    found = score(recorded, dwells)
    assert (found.z**2).sum() < 1.1 * chi2.ppf(1 - 1e-6, found.z.size)
    for i, series in enumerate(recorded.log.force):
        for k in range(len(dwells)):
            x = series.value[(series.time >= dwells.start[k]) & (series.time < dwells.end[k])]
            assert dwells.count[k, i] == len(x)
            np.testing.assert_allclose(dwells.force[k, i], x.mean(axis=0), rtol=1e-12)
            np.testing.assert_allclose(dwells.force_min[k, i], x.min(axis=0), atol=1e-5)
            np.testing.assert_allclose(dwells.force_max[k, i], x.max(axis=0), atol=1e-5)


@pytest.mark.parametrize(("tau", "stop"), [(3.0, 4.0), (1.0, 1.0)])
def test_what_never_settles_is_left_out_with_the_reason(tau: float, stop: float) -> None:
    recipe = Recipe(settle=(20.0, tau, 0.0), stops=(stop,) * 8)
    dwells = find_dwells(record(recipe).log)
    assert len(dwells) == 0
    assert len(dwells.left_out) == 8
    assert {out.reason.code for out in dwells.left_out} == {"stop-unsettled"}


def test_a_stop_too_short_is_named() -> None:
    recorded = record(Recipe(stops=(3.0, 0.15, 3.0, 3.0)))
    dwells = find_dwells(recorded.log)
    assert len(dwells) == 3
    (out,) = dwells.left_out
    assert out.reason.code == "stop-too-short"
    assert recorded.stops[1, 0] - 0.1 < out.start < out.end < recorded.stops[1, 1] + 0.1


@pytest.mark.parametrize("height", [2.0, 20.0])
def test_a_step_of_force_that_the_positions_do_not_show_splits_the_stop(height: float) -> None:
    recorded = record(Recipe(stops=(4.0,) * 6, seed=7))
    at = recorded.stops[2].mean()
    for series in recorded.log.force:
        series.value[(series.time > at) & (series.time < recorded.stops[2, 1])] += height
    dwells = find_dwells(recorded.log)
    inside = (dwells.end > recorded.stops[2, 0]) & (dwells.start < recorded.stops[2, 1])
    assert len(dwells) == 7
    assert inside.sum() == 2
    before, after = np.flatnonzero(inside)
    assert dwells.end[before] <= at + 1e-9
    assert dwells.start[after] >= at - 1e-9
    step = dwells.force[after] - dwells.force[before]
    np.testing.assert_allclose(step, height, atol=6 * np.sqrt(2 / 300))


@pytest.mark.parametrize("length", [0.05, 0.3])
def test_a_jolt_is_cut_out_of_its_dwell(length: float) -> None:
    recorded = record(Recipe(stops=(4.0,) * 6, seed=8))
    at = recorded.stops[3, 0] + 1.7
    for series in recorded.log.force:
        hit = (series.time >= at) & (series.time < at + length)
        wave = np.sin(2 * np.pi * (series.time[hit] - at) / length * 1.5)
        series.value[hit] += 40.0 * wave[:, None]
    dwells = find_dwells(recorded.log)
    assert len(dwells) == 6
    (out,) = dwells.left_out
    assert out.reason.code == "stop-jolted"
    assert out.start <= at < at + length - 1 / 200 <= out.end
    assert out.end - out.start < length + 0.3
    assert np.abs(score(recorded, dwells).z[3]).max() < 4.5
    assert dwells.count[3, 0] < 200 * (4.0 - length)


def test_times_in_milliseconds_are_named() -> None:
    log = record(Recipe(rate=50, stops=STOPS)).log

    def ms(series: Series) -> Series:
        return Series(series.time * 1e3, series.value)

    late = replace(log, position=tuple(map(ms, log.position)), force=tuple(map(ms, log.force)))
    with pytest.raises(DataError, match=r"every 20 s;.*`time.unit`, such as ms"):
        find_dwells(late)


def test_no_dwell_spans_a_gap() -> None:
    recorded = record(Recipe(stops=STOPS))
    log, middle = recorded.log, recorded.stops[4].mean()

    def holed(series: Series) -> Series:
        keep = np.abs(series.time - middle) > 0.4
        return Series(series.time[keep], series.value[keep])

    forces_alone = replace(log, force=tuple(map(holed, log.force)))
    both = replace(forces_alone, position=tuple(map(holed, log.position)))
    for silent in (forces_alone, both):
        dwells = find_dwells(silent)
        assert len(dwells) == len(STOPS) + 1
        assert not np.any((dwells.start < middle) & (dwells.end > middle))


def test_rows_that_are_postures_pass_as_they_are() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(5.0)
    position, force = rng.normal(size=(2, 3, 5, 3))
    later = tuple(Series(time, p) for p in rng.normal(size=(3, 5, 3)))
    log = Log(
        supports=("a", "b", "c"),
        position=tuple(Series(time, p) for p in position),
        force=tuple(Series(time, f) for f in force),
        rows="postures",
        findings=(Finding("log-truncated"),),
    )
    dwells = find_dwells([log, replace(log, position=later, findings=())])
    assert len(dwells) == 10
    np.testing.assert_array_equal(dwells.force[:5], force.transpose(1, 0, 2))
    np.testing.assert_array_equal(dwells.position[:5], position.transpose(1, 0, 2))
    np.testing.assert_array_equal(dwells.position[5:, 1], later[1].value)
    assert not dwells.force_cov.any()
    assert not dwells.position_cov.any()
    assert np.all(dwells.count == 1)
    assert dwells.findings == log.findings
    short = replace(log, force=(Series(time[:4], force[0][:4]), *log.force[1:]))
    with pytest.raises(DataError, match="different numbers of postures"):
        find_dwells(short)
    force[1, 2, 0] = np.inf
    with pytest.raises(DataError, match="posture 3"):
        find_dwells(log)


def warming(time: FloatArray, sensor: int) -> FloatArray:
    """A hall that warms up by 3 K in an hour, each sensor elsewhere."""
    return 20.0 + sensor + 3.0 / 3600.0 * time


def with_fields(fields: int, rate: float = 10.0, noise: float = 0.02) -> Log:
    log = record(Recipe()).log
    time = np.arange(0.0, log.force[0].time[-1], 1.0 / rate)
    rng = np.random.default_rng(0)
    return replace(
        log,
        temperature=tuple(
            Series(time, (warming(time, i) + noise * rng.normal(size=len(time)))[:, None])
            for i in range(fields)
        ),
    )


@pytest.mark.parametrize(("fields", "rate"), [(1, 1.0), (3, 100.0)])
def test_each_dwell_has_the_temperature_of_its_time(fields: int, rate: float) -> None:
    dwells = find_dwells(with_fields(fields, rate))
    assert dwells.temperature is not None
    middle = 0.5 * (dwells.start + dwells.end)
    sensors = range(3) if fields == 3 else [0, 0, 0]
    truth = np.stack([warming(middle, i) for i in sensors], axis=1)
    # A mean over a second: half a second of warming, and the noise of at least one sample.
    assert np.abs(dwells.temperature - truth).max() < 0.5 * 3.0 / 3600.0 + 5 * 0.02


def test_a_field_without_numbers_is_refused() -> None:
    log = with_fields(1)
    empty = Series(log.temperature[0].time, np.full_like(log.temperature[0].value, np.nan))
    with pytest.raises(DataError, match="temperature"):
        find_dwells(replace(log, temperature=(empty,)))
