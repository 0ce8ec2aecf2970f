"""Standard errors, intervals and verdicts against closed forms and repetitions."""

import numpy as np
import pytest
from scipy import stats

from studies.statistics import bias_probability, deviation, drawn_alike, jackknife, mean, ratio

RNG = np.random.default_rng(0)


def test_the_jackknife_of_a_mean_is_its_standard_error() -> None:
    x = RNG.normal(size=20)
    found = jackknife(lambda v: float(v.mean()), x)
    assert found.std == pytest.approx(x.std(ddof=1) / np.sqrt(20))
    assert found.std == pytest.approx(mean(x).std)


def test_the_jackknife_of_deviations_and_ratios_is_their_scatter() -> None:
    runs = [RNG.normal(size=(40, 9)) for _ in range(800)]
    found = [jackknife(deviation, x) for x in runs]
    scatter = np.std([e.value for e in found])
    assert np.sqrt(np.mean([e.std**2 for e in found])) == pytest.approx(scatter, rel=0.1)
    common = RNG.normal(10.0, 2.0, (800, 12))
    pairs = [ratio(0.5 * x + RNG.normal(0, 0.5, 12), x) for x in common]
    scatter = np.std([e.value for e in pairs])
    assert np.sqrt(np.mean([e.std**2 for e in pairs])) == pytest.approx(scatter, rel=0.1)
    assert np.isnan(ratio(np.array([]), np.array([])).value)


@pytest.mark.parametrize("runs", [3, 40])
def test_bias_is_students_t_with_its_degrees_of_freedom(runs: int) -> None:
    error = RNG.normal(0.3, 1.0, (runs, 3, 3))
    p = stats.ttest_1samp(error, 0.0).pvalue
    assert bias_probability(error) == pytest.approx(min(1.0, 9 * p.min()))


@pytest.mark.parametrize("bound", ["", "<", ">"])
def test_one_more_run_is_called_different_at_the_stated_rate(bound: str) -> None:
    draws = np.exp(RNG.normal(size=(4000, 17)))
    called = np.mean([drawn_alike(x[0], x[1:], bound) < 0.05 for x in draws])
    assert abs(called - 0.05) < 3.3 * np.sqrt(0.05 * 0.95 / 4000)
