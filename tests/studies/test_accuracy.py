"""The accuracy study uses the product's own estimators, and says what they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies.reports.accuracy import report
from studies.runs.accuracy import (
    NAMES,
    Accuracy,
    MethodResult,
    Setup,
    accuracy,
    commanded,
    run_block,
)
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.reporting.text import render
from tdfscal.selfcal.linear_method import fit_linear
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, reference_rig, simulate_dwells

RIG = reference_rig()
OPTIONS = Options(squeeze=200.0)


@pytest.fixture(scope="module")
def study() -> Accuracy:
    return accuracy(Setup(RIG, OPTIONS, runs=12, seed=3))


def test_estimates_are_those_of_the_product() -> None:
    setup = commanded(Setup(RIG, OPTIONS), np.random.default_rng(0))
    errors = run_block(setup, tuple(NAMES), 2, np.random.SeedSequence(7))
    again = np.random.default_rng(np.random.SeedSequence(7).spawn(2)[0])
    batch = simulate_dwells(RIG, setup.options, again, 2)
    for k in range(2):
        dwells = batch.dwells(k)
        ml = self_calibrate(RIG, dwells, rng=np.random.default_rng(0), max_trials=0)
        linear = fit_linear(RIG, postures(RIG, dwells))
        truth = batch.truth.rpy[k]
        sigma = ml.uncertainty.rpy_std
        ours, theirs = errors["ml"][0][k], so3.to_rpy(ml.fit.state.rotation) - truth
        assert (np.abs(ours - theirs) < 1e-9 * sigma).all()
        theirs = so3.to_rpy(linear.state.rotation) - truth
        assert (np.abs(errors["linear"][0][k] - theirs) < 1e-6 * sigma).all()
        assert errors["ml"][1][k] == pytest.approx(sigma, rel=0.2)  # before Birge


@pytest.mark.slow
def test_unbiased_and_as_accurate_as_stated() -> None:
    study = accuracy(Setup(RIG, OPTIONS, runs=30, seed=3))
    for method in ("ml", "tracker"):
        result = study.of(method)
        assert result.failed == 0
        assert len(result.error) == 30
        assert result.unbiased
        assert result.stated is not None
        # χ² of 9 × 30 errors about zero; they are not quite independent: 5 standard deviations.
        ratio = np.mean((result.error / result.stated) ** 2)
        assert abs(ratio - 1) < 5 * np.sqrt(2 / 270)
    assert study.ranking[0].method == "ml"
    assert study.of("linear").rms.mean() > 5 * study.of("ml").rms.mean()
    assert "times better than laser tracker" in study.verdict


@pytest.mark.slow
def test_table_2_in_words(study: Accuracy) -> None:
    text = render(report(study, {}))
    assert "is the most accurate on this rig" in text.replace("\n  ", " ")
    assert f"{1e3 * study.of('tracker').std[1, 2]:.4f}" in text
    assert max(map(len, text.splitlines())) <= 80


def result_of(error: FloatArray) -> MethodResult:
    return MethodResult("ml", error, 0, None)


def test_a_bias_is_called_one() -> None:
    error = np.random.default_rng(0).normal(size=(100, 3, 3))
    error -= error.mean(axis=0)
    assert result_of(error).unbiased
    shifted = error.copy()
    shifted[:, 1, 2] += 3.5 * error[:, 1, 2].std(ddof=1) / 10
    assert not result_of(shifted).unbiased
    assert result_of(shifted).bias[1, 2] == pytest.approx(3.5)
    counts, edges = result_of(error).histogram(0, 0)
    assert counts.sum() == 100
    assert len(edges) == len(counts) + 1


def test_processes_change_no_number() -> None:
    setup = Setup(RIG, replace(OPTIONS, postures=10), runs=4, seed=3)
    one, two = (accuracy(setup, workers=workers) for workers in (1, 2))
    for method in NAMES:
        assert np.array_equal(two.of(method).error, one.of(method).error)


def test_too_few_postures_leave_the_linear_method_out() -> None:
    few = accuracy(Setup(RIG, replace(OPTIONS, postures=8), runs=2))
    assert [result.method for result in few.results] == ["ml", "tracker"]
    assert "9 postures" in few.left_out["linear"]
