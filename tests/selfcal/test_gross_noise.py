"""Noise that is not what is stated: whose it is, and what only looks like it."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.records import FloatArray
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.simulation import Faults, Gain, Options, Recorder
from tests.selfcal.campaigns import fitted

RIG = simulation.reference_rig()
OPTIONS = Options(postures=16, squeeze=150.0, recorder=Recorder(mean_sd=0.1))


def disturbed(seed: int, added: FloatArray) -> SelfCalibration:
    """A campaign of 16 postures with forces (16, 3, 3) added to its readings."""
    batch = simulation.simulate_dwells(RIG, OPTIONS, np.random.default_rng(seed), 1)
    dwells = batch.dwells(0)
    dwells = replace(dwells, force=dwells.force + added)
    return fitted(RIG, dwells)


@pytest.mark.parametrize(("seed", "support", "axis", "size"), [(5, 0, 1, 1.2), (8, 1, 0, 5.0)])
def test_a_noisy_channel_is_named(seed: int, support: int, axis: int, size: float) -> None:
    """1.2 N, nine times the stated 0.14 N, is a thousandth of the load at most."""
    added = np.zeros((16, 3, 3))
    added[:, support, axis] = size * np.random.default_rng(seed).standard_normal(16)
    result = disturbed(seed, added)
    assert result.reasons
    assert ("sensor noise", support) in [(s.kind, s.support) for s in result.suspicions]


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
    result = fitted(rig, dwells)
    causes = [f for f in result.reasons if f.code not in ("residuals-large", "angle-uncertain")]
    assert [(cause.code, cause.subject) for cause in causes] == [("gain-suspected", ("ncp4",))]


def test_noise_that_is_overstated_is_said() -> None:
    dwells = simulation.simulate_dwells(
        RIG, Options(squeeze=100.0), np.random.default_rng(3), 1
    ).dwells(0)
    for stated in ({"force_noise": 0.3}, {"positioner": 3e-4}):
        rig = replace(RIG, declared=replace(RIG.declared, **stated))
        result = fitted(rig, dwells)
        assert "noise-overstated" in [each.code for each in result.findings]
