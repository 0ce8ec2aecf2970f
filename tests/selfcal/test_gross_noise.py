"""A channel is weighted by its noise as far as one that works can be noisy, and no farther."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.findings import Finding
from tdfscal.records import FloatArray
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Faults, Gain, Options, Recorder
from tests.words import in_words

RIG = simulation.reference_rig()
TOUCHED = (1, 4, 6, 9, 11, 14)
OPTIONS = Options(postures=16, squeeze=150.0, recorder=Recorder(mean_sd=0.1))


def disturbed(seed: int, added: FloatArray) -> SelfCalibration:
    """A campaign of 16 postures with forces (16, 3, 3) added to its readings."""
    batch = simulation.simulate_dwells(RIG, OPTIONS, np.random.default_rng(seed), 1)
    dwells = batch.dwells(0)
    dwells = replace(dwells, force=dwells.force + added)
    return self_calibrate(RIG, dwells, rng=np.random.default_rng(0), max_trials=0)


def gross(result: SelfCalibration) -> Finding | None:
    """The channel that is noisier than one that works can be."""
    return next((found for found in result.reasons if found.code == "channel-broken"), None)


@pytest.mark.parametrize("size", [10.0, 300.0])
def test_contact_at_one_channel_passes_for_no_noise(size: float) -> None:
    added = np.zeros((16, 3, 3))
    added[list(TOUCHED), 1, 0] = size * np.array([1.0, -0.8, 1.1, 0.9, -1.0, 1.2])
    result = disturbed(3, added)
    assert result.reasons
    if (found := gross(result)) is not None:
        assert found.values["channel"] == "Fx of ncp2"
        assert set(found.values["postures"]) <= {str(k + 1) for k in TOUCHED}  # type: ignore[arg-type]
        words = in_words([found])[0]
        assert "Fx of ncp2" in words
        assert "contact" in words
        assert "broken" in words
    else:
        assert len(result.rejected) > 1


@pytest.mark.parametrize(("seed", "support", "axis", "size"), [(5, 0, 1, 1.2), (8, 1, 0, 5.0)])
def test_a_noisy_channel_is_weighted_and_a_broken_one_named(
    seed: int, support: int, axis: int, size: float
) -> None:
    """1.2 N, nine times the stated 0.14 N, is a thousandth of the load at most.

    Where all 16 scatter by 5 N the wildest third would be outliers by the stated noise.
    """
    added = np.zeros((16, 3, 3))
    added[:, support, axis] = size * np.random.default_rng(seed).standard_normal(16)
    result = disturbed(seed, added)
    found = gross(result)
    if size < 2.0:
        assert found is None
        assert result.channels is not None
        assert not result.reasons
        return
    assert found is not None
    assert found.values["channel"] == f"F{'xyz'[axis]} of ncp{support + 1}"
    # χ² of 16 degrees: the scatter is known to 0.57 … 1.6 of itself, one in a thousand either way.
    assert 0.5 * size < (found.size or 0.0) < 1.7 * size
    assert size > 5.0 or not result.rejected


@pytest.mark.parametrize("size", [0.01, pytest.param(0.05, marks=pytest.mark.slow)])
def test_a_wrong_gain_is_named_before_the_noise_that_it_looks_like(size: float) -> None:
    """Its misfit varies from posture to posture and is 14 to 500 times the noise of a channel."""
    options = Options(
        postures=27,
        squeeze=400.0,
        recorder=Recorder(mean_sd=0.05),
        faults=Faults(gains=(Gain(3, (size,) * 3),)),
    )
    rig = simulation.make_rig(4, mass=1500.0, radius=0.4)
    dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(1), 1).dwells(0)
    result = self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
    causes = [f for f in result.reasons if f.code not in ("residuals-large", "angle-uncertain")]
    assert [(cause.code, cause.subject) for cause in causes] == [("gain-suspected", ("ncp4",))]


def test_channels_that_explain_as_much_are_named_beside() -> None:
    """Five sensors, three unknown forces at each posture at least: many channels look alike."""
    rig = simulation.make_rig(5)
    batch = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(4), 1)
    dwells, noise = batch.dwells(0), np.random.default_rng(9).standard_normal(16)
    force = dwells.force.copy()
    force[:, 1, 0] += 8.0 * noise
    result = self_calibrate(
        rig, replace(dwells, force=force), rng=np.random.default_rng(0), max_trials=0
    )
    found = gross(result)
    assert found is not None
    assert "Fx of ncp2" in (found.values["channel"], *found.values["alike"])  # type: ignore[misc]


def test_noise_that_is_overstated_is_said_with_what_the_residuals_support() -> None:
    """Of 0.1 N in truth: χ² of 135 degrees of freedom knows f² + s² of a mean to 12 %."""
    batch = simulation.simulate_dwells(RIG, Options(squeeze=100.0), np.random.default_rng(3), 1)
    dwells, true = batch.dwells(0), RIG.declared.force_noise
    total = true**2 + np.diagonal(dwells.force_cov, axis1=2, axis2=3).mean()
    for stated in ({"force_noise": 0.3}, {"positioner": 3e-4}):
        rig = replace(RIG, declared=replace(RIG.declared, **stated))
        result = self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
        (found,) = (each for each in result.findings if each.code == "noise-overstated")
        assert found.values.keys() == stated.keys()
        if "force_noise" in stated:
            said = float(str(found.values["force_noise"]))
            assert said**2 == pytest.approx(true**2, abs=4 * 0.12 * total)
