"""Campaigns calibrated by each method; sources of uncertainty that can be taken away."""

from dataclasses import replace

import numpy as np

from studies import campaigns
from studies.campaigns import Setting, errors
from tdfscal.numerics import so3
from tdfscal.simulation import reference_rig, simulate_dwells
from tests.selfcal.campaigns import fitted

RIG = reference_rig()
FEW = Setting(postures=10)


def test_maximum_likelihood_is_that_of_the_product() -> None:
    seed = np.random.SeedSequence(7)
    found = errors(RIG, Setting(), ("ml",), 2, seed)["ml"]
    block = np.random.SeedSequence(7).spawn(1)[0]
    batch = simulate_dwells(RIG, Setting().options, np.random.default_rng(block.spawn(2)[0]), 2)
    for k in range(2):
        own = fitted(RIG, batch.dwells(k))
        theirs = so3.to_rpy(own.fit.state.rotation) - batch.truth.rpy[k]
        assert (np.abs(found[k] - theirs) < 1e-9 * own.uncertainty.rpy_std).all()


def test_eq_24_alone_of_noise_is_exact_without_it() -> None:
    """No source left: every estimator finds the truth."""
    rig = campaigns.without(campaigns.papers_sources(RIG), "positioners")
    silent = replace(Setting(), noise=0.0)
    arms = ("linear", "linear-forces", "angles", "angles-forces")
    found = errors(rig, silent, arms, 2, np.random.SeedSequence(1))
    for error in found.values():
        # The servo coordinates have 0.3 µm of encoder noise over 0.6 m, some of a microradian.
        assert np.abs(error).max() < 1e-4
