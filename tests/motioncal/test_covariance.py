"""What noise of the readings and errors of the place do to the estimate."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.calibrated import free_constants, joint_prior
from tdfscal.motioncal.blocks import rests_of
from tdfscal.motioncal.estimator import at_state, fit_moving
from tdfscal.motioncal.fit import FIELD, MovingFit, MovingPriors, of_poses
from tdfscal.motioncal.rows import Bins, NoiseModel, at_mean, improve
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


@pytest.mark.parametrize("ratio", [0.0, 0.5, 3.0])
def test_a_spectrum_stands_at_the_mean_of_its_logarithm(ratio: float) -> None:
    """Against sums over a grid of both levels: 60 values, half of them by forces alone."""
    each, H = np.ones(60), 2
    bins = Bins(each, np.where(np.arange(60) < 30, 0.0, ratio), each)
    precision, mode = np.diag([0.01, 1e4, 1.0, 1e4]), np.zeros(2 * H)
    model = NoiseModel(np.log([1.0, 2.0]), mode, mode, precision, np.linalg.inv(precision))
    power = model.variance(bins)
    model, _ = improve(model, bins, power, 0 * each)
    force, place = np.meshgrid(*(np.linspace(-6, 6, 401),) * 2, indexing="ij")
    variance = np.exp(force)[..., None] + np.array([0.0, ratio]) * np.exp(place)[..., None]
    value = 15 * np.sum(np.log(variance) + power[[0, -1]] / variance, axis=2)
    chance = np.exp(-value + value.min() - 0.005 * force**2 - 0.5 * place**2)
    mean = [np.sum(chance * own) / np.sum(chance) for own in (force, place)]
    found = at_mean(model, bins, 0 * each).log_density[::H]
    assert found == pytest.approx(mean, abs=0.01 + 0.25 * np.abs(mean).max())


def test_earlier_campaigns_are_counted_once(fit: MovingFit) -> None:
    """Where they know all of the rig, what they state of it is what is stated."""
    count = int(free_constants(fit.rig).sum())
    known = Information(np.eye(count) / 1e-7**2, np.zeros(count))
    rig = replace(fit.rig, earlier=joint_prior(fit.rig, fit.state.still, known))
    again = at_state(MovingPriors(rig, fit.slow, DELAY), fit.blocks, fit.state, fit.noise)
    std = np.sqrt(np.diag(estimate(again).uncertainty.covariance))
    assert std == pytest.approx(np.full(9, 1e-7), rel=0.01)


@pytest.mark.parametrize("way_off", ["place", "force"])
def test_what_is_off_at_a_rest_is_an_unknown_of_its_own(way_off: str) -> None:
    """One NCP stands 20 µm off at one posture, or its sensor reads 0.2 N more: the unknowns of that
    rest take it up, no other."""
    campaign, slow, cut = played(STOPS, 7)
    rig, state = campaign.rig, true_state(campaign)
    plain = at_state(MovingPriors(rig, slow, DELAY), cut, state, None)
    run = rests_of(slow, cut)[0][3]
    way = np.linalg.norm(slow.position - slow.position[run].mean(axis=0), axis=2).max(axis=1)
    near = np.exp(-0.5 * (way / 0.01) ** 2)
    near[: run.start - 40] = near[run.stop + 40 :] = 0.0
    position, force = slow.position.copy(), slow.force.copy()
    if way_off == "place":
        position[:, 1] += 2.0e-5 * near[:, None] * np.array([0.6, -0.5, 0.62])
    else:
        force[:, 1] += 0.2 * near[:, None] * np.array([0.6, -0.5, 0.62])
    there = replace(slow, position=position, force=force)
    moved = at_state(MovingPriors(rig, there, DELAY), cut, state, plain.noise)
    # Below 1 Hz: as it comes and goes, 20 µm in half a second shake the mass a little.
    slow_part = cut[0].frequency < 1.0
    rows = slice(3, 6) if way_off == "place" else slice(0, 6)
    change = (moved.wrenches()[0] - plain.wrenches()[0])[slow_part, rows].ravel()
    columns = plain.designs[0].rests[slow_part, rows].reshape(len(change), 8, 9)
    columns = np.split(columns, [3], axis=2)[way_off == "force"]
    own = columns[:, 3]
    both = np.concatenate([own.real, own.imag])
    amount, *_ = np.linalg.lstsq(both, np.concatenate([change.real, change.imag]), rcond=None)
    left = change - own @ amount
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(change)
    # In units of the prior: 20 µm, 0.2 N, where the rig file states 10 µm and 0.1 N per axis of
    # three NCPs.
    assert 0.5 < np.linalg.norm(amount) < 4.0
    others = np.delete(columns, 3, axis=1).reshape(len(change), -1)
    part, *_ = np.linalg.lstsq(others, change, rcond=None)
    assert np.linalg.norm(change - others @ part) > 0.8 * np.linalg.norm(change)
