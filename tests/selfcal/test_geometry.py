"""A rig file whose hinge, or a positioner whose datum, is off: named, and its harm told."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.files.rig.draft import sketch_rig
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.linear_method import SOURCE
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, Recorder
from tests.selfcal.campaigns import distance, fitted

OPTIONS = Options(squeeze=200.0, recorder=Recorder(mean_sd=0.1))


def recorded(rig: Rig, seed: int) -> tuple[Dwells, FloatArray]:
    """A campaign of a rig, and its true rotations."""
    batch = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(seed), 1)
    return batch.dwells(0), batch.truth.rotation[0]


@pytest.mark.parametrize(("size", "radius", "rejected"), [(5e-3, 2.0, True), (2e-4, 10.0, False)])
def test_a_displaced_hinge_is_named(size: float, radius: float, rejected: bool) -> None:
    rig = simulation.make_rig(3, radius=radius)
    dwells, truth = recorded(rig, 1)
    hinge = rig.hinge.copy()
    hinge[1, :2] += size * np.array([0.6, -0.8])
    result = fitted(replace(rig, hinge=hinge), dwells)
    doubt = result.suspicions[0]
    assert (doubt.kind, doubt.support) == ("hinge", 1)
    (told,) = (cause for cause in doubt.causes if cause.code == "hinge-misplaced")
    assert told.subject == ("ncp2",)
    assert told.size == pytest.approx(size, abs=1e-4)  # 20 µm per coordinate
    assert bool(result.reasons) is rejected
    assert "hinge-misplaced" in {found.code for found in result.findings}
    if not rejected:  # the stated uncertainty holds it: d² within χ² of 9 degrees at a thousandth
        assert distance(truth, result) < 27.9


def test_a_warned_geometry_widens_the_angles_by_the_move_that_it_names() -> None:
    """And the trials agree: intervals by 20,000 of them hold the same move."""
    rig = simulation.make_rig(3, radius=2.0)
    dwells, truth = recorded(rig, 3)
    hinge = rig.hinge.copy()
    hinge[0] += 1e-3 * np.array([0.0, 0.6, 0.0])
    rig_file, rng = replace(rig, hinge=hinge), np.random.default_rng(0)
    result = self_calibrate(rig_file, dwells, rng=rng, max_trials=20_000)
    (doubt,) = result.suspicions
    assert not doubt.harmful
    assert doubt.move is not None
    move = doubt.move[:9]
    own = result.uncertainty.covariance - np.outer(move, move)
    plain = fitted(rig, dwells).uncertainty.covariance
    np.testing.assert_allclose(np.diagonal(own), np.diagonal(plain), rtol=0.02)
    share = result.uncertainty.contributions["undeclared error"]
    assert np.max(np.sqrt(share)) == pytest.approx(doubt.harm, rel=0.05)
    assert result.monte_carlo is not None
    assert result.monte_carlo.validated
    assert distance(truth, result) < 27.9
    # The linear method has the covariance of its own trials, whatever is doubted.
    linear = self_calibrate(rig_file, dwells, rng=rng, estimator="linear", max_trials=100)
    assert linear.suspicions
    assert list(linear.uncertainty.contributions) == [SOURCE]


@pytest.mark.parametrize(("support", "axis"), [(2, 1), (1, 0)])
def test_an_axis_out_of_scale_is_told_though_it_measured_the_hinges(
    support: int, axis: int
) -> None:
    """The angles move as far as is told, and what is told to write mends scale and hinges."""
    rig = simulation.reference_rig()
    dwells, _ = recorded(rig, 7)

    def drafted(position: FloatArray) -> Rig:
        stated = replace(rig.declared, hinge=1e-4, datum=1e-4)
        drawn = sketch_rig(position, dwells.force, rig.gravity)
        middle = UncertainValue(np.array([*drawn.barycentre, 0.0]), np.array([0.02, 0.02, np.inf]))
        return replace(rig, hinge=drawn.hinge, barycentre=middle, declared=stated)

    place = dwells.position.copy()
    place[:, support, axis] *= 1.01
    right, wrong = drafted(dwells.position), drafted(place)
    result = fitted(wrong, replace(dwells, position=place))
    (doubt,) = result.suspicions
    assert doubt.harmful
    assert doubt.move is not None
    sound = fitted(right, dwells)
    turned = so3.log(result.rotations.rotation @ np.swapaxes(sound.rotations.rotation, 1, 2))
    np.testing.assert_allclose(doubt.move[:9], turned.ravel(), atol=0.05 * doubt.harm)
    told = doubt.causes[0].values
    hinge = wrong.hinge.copy()
    hinge[support] = told["hinges"]
    place[:, support] *= np.array(told["signs"])
    assert not fitted(replace(wrong, hinge=hinge), replace(dwells, position=place)).suspicions
