"""A channel is weighted by its noise as far as one that works can be noisy, and no farther."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.records import FloatArray
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Options, Recorder
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


@pytest.mark.parametrize("size", [10.0, 60.0, 300.0])
def test_contact_at_one_channel_passes_for_no_noise(size: float) -> None:
    added = np.zeros((16, 3, 3))
    added[list(TOUCHED), 1, 0] = size * np.array([1.0, -0.8, 1.1, 0.9, -1.0, 1.2])
    result = disturbed(3, added)
    assert result.reasons
    if result.gross is not None:
        assert (result.gross.support, result.gross.axis) == ("ncp2", "x")
        assert set(result.gross.postures) <= {k + 1 for k in TOUCHED}
        words = in_words([result.gross.finding])[0]
        assert result.gross.finding in result.reasons
        assert "Fx of ncp2" in words
        assert "contact" in words
        assert "broken" in words
    else:
        assert len(result.rejected) > 1


@pytest.mark.parametrize("size", [0.6, 1.2])
def test_a_moderately_noisy_channel_is_weighted(size: float) -> None:
    """6 and 12 times the stated 0.14 N, which is a thousandth of the load at most."""
    added = np.zeros((16, 3, 3))
    added[:, 0, 1] = size * np.random.default_rng(5).standard_normal(16)
    result = disturbed(5, added)
    assert result.gross is None
    assert result.channels is not None
    assert not result.reasons


def test_a_broken_channel_is_named() -> None:
    added = np.zeros((16, 3, 3))
    added[:, 2, 2] = 30.0 * np.random.default_rng(6).standard_normal(16)
    result = disturbed(6, added)
    assert result.gross is not None
    assert (result.gross.support, result.gross.axis) == ("ncp3", "z")
    # χ² of 16 degrees: the scatter is known to 0.57 … 1.6 of itself, one in a thousand either way.
    assert 0.5 * 30.0 < result.gross.noise < 1.7 * 30.0
