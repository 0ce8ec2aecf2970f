"""What the positioners' errors do to the estimate: a field of the place, no noise of the time."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.calibrated import free_constants, joint_prior
from tdfscal.motioncal.estimator import at_state, fit_moving
from tdfscal.motioncal.fit import FIELD, MovingFit, MovingPriors, of_poses
from tdfscal.numerics.information import Information
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import FloatArray
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, played, true_state

#: Stiff carriages: the internal forces, and with them a pose error's moment, differ by posture.
STOPS = replace(MovingOptions.stops(), rate=100.0, stiffness=(2e8, 2e8, 2e8), duration=76.0)


@pytest.fixture(scope="module")
def fit() -> MovingFit:
    campaign, slow, cut = played(STOPS, 7)
    return fit_moving(MovingPriors(campaign.rig, slow, DELAY), cut, true_state(campaign))


def moved(fit: MovingFit, wrench: FloatArray) -> FloatArray:
    """Moves (D, 9) of the angles by wrenches (D, N, 6) of one block."""
    item = fit.designs[0]
    own, root = item.rows(fit.rests), spectrum(fit.whitened()[1]).root
    gain = own.design @ fit.slope * (own.bins.count / fit.noise.variance(own.bins))[:, None]
    e = item.block.transform(np.moveaxis(wrench, 0, 2))  # (F, 6, D)
    return np.asarray((root @ (root.T @ (gain.T @ item.real(e))))[:9].T)


def test_errors_of_the_place_move_the_angles_by_their_share(fit: MovingFit) -> None:
    item, rng = fit.designs[0], np.random.default_rng(1)
    C = spectrum(fit.whitened()[1]).root
    share = of_poses(fit, (C @ C.T)[: int(fit.active.sum())])[:9, :9]
    place = fit.slow.position[item.block.index].reshape(len(item.turned), -1)
    way = np.sum((place[:, None] - place) ** 2, axis=2) / fit.rig.n
    alike = 1 / (1 + way / (2 * FIELD**2)) + 1e-9 * np.eye(len(place))
    f = item.block.frequency
    power = 2 * np.trapezoid(fit.noise.density(f)[1], f)
    turns = np.sqrt(power) * np.linalg.cholesky(alike) @ rng.standard_normal((len(way), 450))
    wrench = np.einsum("kac,kcd->dka", item.turned, turns.reshape(len(way), 3, 150))
    out = moved(fit, wrench)
    # 150 draws of nine angles that go together in part: 8 % of a standard error.
    assert np.trace(out.T @ out / 150) == pytest.approx(np.trace(share), rel=0.25)


def test_earlier_campaigns_are_counted_once(fit: MovingFit) -> None:
    """Where they know all of the rig, what they state of it is what is stated."""
    count = int(free_constants(fit.rig).sum())
    known = Information(np.eye(count) / 1e-7**2, np.zeros(count))
    rig = replace(fit.rig, earlier=joint_prior(fit.rig, fit.state.still, known))
    again = at_state(MovingPriors(rig, fit.slow, DELAY), fit.blocks, fit.state, fit.noise)
    std = np.sqrt(np.diag(estimate(again).uncertainty.covariance))
    assert std == pytest.approx(np.full(9, 1e-7), rel=0.01)
