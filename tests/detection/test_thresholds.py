"""Thresholds against closed forms, and against paths drawn from noise and systematic errors."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.special import ndtri
from scipy.stats import binom

from tdfscal.detection.noise import LowPass, measured_noise
from tdfscal.detection.threshold import Noise, Places, Watch, crossing_probability
from tdfscal.records import FloatArray

LEVELS = np.array([0.0, 1.0, 2.5, 4.0])
NONE = Noise(0.0, 0.0, 0.0, 1.0, 0.01)


def relaxing(rng: np.random.Generator, size: tuple[int, int], steps: float) -> FloatArray:
    """Ornstein–Uhlenbeck processes of variance 1 along the last axis."""
    pole = np.exp(-1.0 / steps)
    white = rng.standard_normal(size)
    white[:, 1:] *= np.sqrt(1.0 - pole**2)
    return np.asarray(lfilter([1.0], [1.0, -pole], white, axis=1))


def test_alike_samples_cross_as_rice_has_it() -> None:
    correlation = 1.0 - 1e-7
    rice = np.arccos(correlation) / (2.0 * np.pi) * np.exp(-(LEVELS**2) / 2.0)
    assert crossing_probability(LEVELS, correlation) == pytest.approx(rice, rel=1e-5)


@pytest.mark.parametrize("probability", [0.3, 1e-3, 1e-7])
def test_a_calibration_alone_gives_the_normal_quantile(probability: float) -> None:
    factor = np.full((5, 1), 3.0)
    watch = Watch(Places.of(factor, np.ones(5), 0.0), NONE, 100.0)
    expected = -3.0 * ndtri(probability / 2.0)
    assert watch.threshold(probability) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("fast", "slow", "systematic"),
    [(1.0, 0.0, 0.5), (1.0, 0.5, 1.0), (0.3, 1.0, 0.0), (0.2, 0.3, 2.0)],
)
def test_paths_stop_and_see_as_often_as_stated(fast: float, slow: float, systematic: float) -> None:
    rng = np.random.default_rng(5)
    rate, duration, probability, trials = 50, 20, 0.1, 4000
    factor = systematic * rng.standard_normal((20, 4))
    noise = Noise(fast, 0.0, slow, 1.0, 1.0 / rate)
    watch = Watch(Places.of(factor, np.ones(20), noise.std), noise, duration)
    threshold = watch.threshold(probability)
    contact = watch.smallest_contact(threshold, 0.95)
    stopped, seen = 0, []
    for _ in range(4):
        size = (trials // 4, rate * duration)
        wrench = np.repeat(rng.standard_normal((size[0], 4)) @ factor.T, rate, axis=1)
        wrench += fast * rng.standard_normal(size) + slow * relaxing(rng, size, rate)
        stopped += int(np.sum(np.abs(wrench).max(axis=1) > threshold))
        seen.append(np.mean(np.abs(wrench[:, rate // 2 :: rate] + contact) > threshold))
    # Four standard deviations of the count, and 4 % of the approximations.
    low, high = binom.interval(0.9999, trials, probability)
    assert 0.96 * low <= stopped <= 1.04 * high
    assert np.mean(seen) == pytest.approx(0.95, abs=0.012)


def test_the_filter_is_scipys_butterworth() -> None:
    rng, rate = np.random.default_rng(1), 200.0
    time, value = np.arange(2000) / rate, rng.standard_normal((2000, 6))
    low = LowPass(7.0, 1.0 / rate)
    parts = [low(time[k : k + 300], value[k : k + 300]) for k in range(0, 2000, 300)]
    expected = lfilter(*butter(2, 7.0, fs=rate), value, axis=0)
    late = time > 1.0
    assert np.concatenate(parts)[late] == pytest.approx(expected[late], abs=1e-9)


@pytest.mark.parametrize(("cutoff", "share"), [(None, 1.0), (5.0, np.pi / np.sqrt(8.0) * 0.1)])
def test_noise_of_dwells_is_measured(cutoff: float | None, share: float) -> None:
    rng, rate, length = np.random.default_rng(2), 100, 30
    N = 20 * length * rate
    slow = relaxing(rng, (6, N), rate).T
    value = 2.0 * rng.standard_normal((N, 6)) + 1.0 * slow
    rest = [slice(k * length * rate, (k + 1) * length * rate) for k in range(20)]
    found = measured_noise(np.arange(N) / rate, value, rest, cutoff)
    fast, stands = (
        np.array([getattr(one, what) for one in found.components]) for what in ("fast", "slow")
    )
    assert found.resting
    assert found.spans == 20
    assert fast == pytest.approx(2.0 * np.sqrt(share), rel=0.1)
    # 600 s of a relaxation of 1 s: some 300 independent values.
    assert stands == pytest.approx(1.0, rel=0.2)
