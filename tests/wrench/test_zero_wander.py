"""How far zeros have moved since they were calibrated: by what is declared, and by 1/f noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import tdfscal
from tdfscal.files.writers.campaign import write_campaign
from tdfscal.model.postures import ZeroAge
from tdfscal.model.samples_in_motion import Samples
from tdfscal.records import Drift, FloatArray, Log, Series
from tdfscal.simulation import Campaign, Options, Recorder, make_rig, simulate_campaign
from tdfscal.wrench.wrench_noise import LogHead, flicker, flicker_level, moved_zeros

STEP, DWELL, SPAN, LEVEL = 0.1, 4.0, 100.0, 0.5
CHANNELS = 300
ALL = np.ones((CHANNELS // 3, 3), dtype=np.bool_)


def one_over_f(rng: np.random.Generator, seconds: float, longer: int = 8) -> FloatArray:
    """1/f noise (N, CHANNELS) of one-sided density LEVEL / f, N²/Hz, from far below 1/seconds."""
    count = round(seconds / STEP)
    size = longer << (count - 1).bit_length()
    f = np.fft.rfftfreq(size, STEP)[1:]
    # E |X|² = N S / (2 dt) for a one-sided density S.
    sd = np.sqrt(size * LEVEL / f / (2 * STEP) / 2)
    out = np.empty((count, CHANNELS))
    for channel in out.T:
        wave = sd * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
        channel[:] = np.fft.irfft(np.append(0.0, wave), size)[:count]
    return out


def means(noise: FloatArray, start: float, end: float) -> FloatArray:
    """Means (dwells, CHANNELS) of consecutive dwells."""
    size = round(DWELL / STEP)
    part = noise[round(start / STEP) : round(end / STEP)]
    count = len(part) // size
    return np.asarray(part[: count * size].reshape(count, size, -1).mean(axis=1))


def test_the_zero_s_own_wander_is_that_of_simulated_noise() -> None:
    noise = one_over_f(np.random.default_rng(1), 500.0)
    used = means(noise, 0.0, SPAN)
    zero = used.mean(axis=0)
    within = np.mean((used - zero) ** 2)
    assert within == pytest.approx(LEVEL * np.log(SPAN / DWELL), rel=0.1)
    wander = flicker(LEVEL, 0.0, ZeroAge(0.0), SPAN)
    assert wander is not None
    # The relative standard error of a variance of 300 channels is 8 %.
    for start in (SPAN, 250.0, 460.0):
        late = means(noise, start, start + 2 * DWELL)
        seen = np.mean((late - zero) ** 2) - within
        told = wander(np.array([start + DWELL]))[0, 0]
        assert seen == pytest.approx(told, abs=0.2 * (told + within))
        assert told > 0.3 * within


def head_of(force: FloatArray, dwells: int, mean_variance: float) -> LogHead:
    """A log of dwells one after the other; the variance of their means as dwells alone show it."""
    time = STEP * np.arange(float(len(force)))
    start = DWELL * np.arange(float(dwells))
    samples = Samples(time, np.zeros((len(force), 1, 3)), force.reshape(len(force), -1, 3))
    return LogHead(samples, start, start + DWELL - STEP / 2, mean_variance, averaged=False)


def test_the_level_of_one_over_f_noise_is_found() -> None:
    noise = one_over_f(np.random.default_rng(2), SPAN)
    posture = float(np.var(means(noise, 0.0, SPAN), axis=0).mean())
    white = float(noise[: round(DWELL / STEP)].var(axis=0).mean()) * STEP / DWELL
    found = flicker_level(head_of(noise, 25, white), ALL, posture, SPAN, DWELL)
    assert found == pytest.approx(LEVEL, rel=0.15)


@pytest.mark.parametrize("kind", ["white", "short memory", "constant within a posture"])
def test_no_other_noise_is_taken_for_it(kind: str) -> None:
    rng, count = np.random.default_rng(3), round(SPAN / STEP)
    noise, mean_variance = rng.standard_normal((count, CHANNELS)), STEP / DWELL
    if kind == "short memory":
        noise = np.sqrt(1 - 0.8**2) * lfilter([1.0], [1.0, -0.8], noise, axis=0)
        mean_variance *= (1 + 0.8) / (1 - 0.8)
    if kind == "constant within a posture":
        noise = 0.1 * noise + np.repeat(rng.standard_normal((25, CHANNELS)), 40, axis=0)
    total = float(noise.var())
    posture = float(np.var(means(noise, 0.0, SPAN), axis=0).mean())
    head = head_of(noise, 25, mean_variance)
    assert flicker_level(head, ALL, posture, SPAN, DWELL) < 0.02 * total


def test_zeros_that_move_count_from_where_they_held() -> None:
    drift = Drift(time=2e-3, temperature=0.1, walk=0.05)
    warm = lambda time: 20.0 + 0.01 * np.repeat(time[:, None], 3, axis=1)  # noqa: E731
    variance = moved_zeros(drift, 100.0, ZeroAge(400.0, 1.5), warm)
    assert variance is not None
    at = np.array([100.0, 700.0])
    expected = [
        (2e-3 * s) ** 2 + 0.05**2 * s + (0.1 * dt) ** 2 for s, dt in ((400, 1.5), (1000, 7.5))
    ]
    np.testing.assert_allclose(variance(at), np.repeat(expected, 3).reshape(2, 3), rtol=1e-12)
    unknown = moved_zeros(Drift(time=np.inf), 100.0, ZeroAge(), None)
    assert unknown is not None
    assert unknown(at)[0].tolist() == [0.0]
    assert np.isinf(unknown(at)[1]).all()
    assert moved_zeros(Drift(), 0.0, ZeroAge(9.0), warm) is None


RATE = 1.0e-3  # N/s, std of a slope
HOUR = 3600.0


def shifted(log: Log, start: float, end: float, by: float) -> Log:
    def part(s: Series) -> Series:
        keep = (s.time >= start) & (s.time < end)
        return Series(s.time[keep] + by, s.value[keep])

    return replace(log, position=tuple(map(part, log.position)), force=tuple(map(part, log.force)))


@pytest.fixture(scope="module")
def drifting() -> Campaign:
    recorder = Recorder(dwell=(2.0, 2.5), move=(1.0, 1.5), force_rate=50.0, position_rate=50.0)
    options = Options(postures=14, squeeze=300.0, recorder=recorder)
    rig = replace(make_rig(), drift=Drift(time=RATE))
    return simulate_campaign(rig, options, np.random.default_rng(5))


@pytest.mark.parametrize(("clock", "later"), [(1.76e9, 2 * HOUR), (0.0, 0.0)])
def test_drift_since_then(drifting: Campaign, tmp_path: Path, clock: float, later: float) -> None:
    """By the clocks of both logs; without them, from as long before as the calibration lasted."""
    c, middle = drifting, 0.5 * (drifting.end[11] + drifting.start[12])
    used = replace(c, log=shifted(c.log, 0.0, middle, clock))
    held = replace(c, log=shifted(c.log, middle, np.inf, clock + later))
    still = replace(held, rig=replace(c.rig, drift=Drift()))
    for name, part in (("used", used), ("held", held), ("still", still)):
        write_campaign(part, tmp_path / name, format="parquet")
    found = tdfscal.calibrate([tmp_path / "used"], trials=0)
    with_drift, without = (tdfscal.apply(found, [tmp_path / name]) for name in ("held", "still"))
    assert with_drift.columns is not None
    assert without.columns is not None
    added = with_drift.columns["u_fx"] ** 2 - without.columns["u_fx"] ** 2
    time = with_drift.columns["time"]
    assert found.postures is not None
    first, last = found.postures.start[0], found.postures.end[-1]
    elapsed = time - first if clock else time - time[0] + last - first
    # The forces of three sensors add up; u² itself is of the order of 1 N².
    np.testing.assert_allclose(added, 3 * (RATE * elapsed) ** 2, rtol=1e-3, atol=1e-9)
    assert with_drift.summary["zeros"]["age_known"] is bool(clock)
    assert with_drift.summary["zeros"]["moved"] == pytest.approx(RATE * elapsed[-1], rel=0.05)
