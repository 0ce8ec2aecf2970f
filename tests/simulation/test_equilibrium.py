"""The terminal's rest, checked by virtual work, closed forms and the sum of forces."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.errors import NotConvergedError, UsageError
from tdfscal.records import FloatArray
from tdfscal.simulation import (
    Equilibrium,
    Load,
    Options,
    Pose,
    Truth,
    draw_truths,
    internal_part,
    settle,
    simulate_campaign,
)

from .rigs import chi2_p, exact_rig, loose_rig, plausible, still


def scene(seed: int, K: int = 6) -> tuple[Truth, FloatArray, Load, Equilibrium]:
    """An uncertain rig on anisotropic carriages, leaning, squeezed, touched, with friction."""
    rng = np.random.default_rng(seed)
    rig = loose_rig()
    carriages = rng.normal(size=(3, 3, 3))
    stiffness = 2.0e7 * (np.eye(3) + 0.1 * carriages @ np.swapaxes(carriages, 1, 2))
    truth = draw_truths(rig, Options(stiffness=stiffness), rng, 1).trial(0)
    R = Rotation.from_rotvec(rng.normal(scale=0.15, size=(K, 3))).as_matrix()
    T = rng.normal(scale=0.1, size=(K, 3)) + np.array([0.0, 0.0, 1.0])
    stand = rig.hinge @ np.swapaxes(R, 1, 2) + T[:, None] + rng.normal(scale=2e-5, size=(K, 3, 3))
    contact = rng.normal(scale=50.0, size=(K, 2, 3))
    load = Load(contact, rng.normal(size=(K, 3)))
    return truth, stand, load, settle(truth, stand, load, Pose(R, T))


def test_no_net_wrench_about_any_point() -> None:
    seed = 1
    truth, _, load, rest = scene(seed)
    R, T = rest.pose.rotation, rest.pose.translation
    about = np.random.default_rng(seed).normal(scale=2.0, size=3)
    for k in range(len(R)):
        weight = float(truth.mass) * truth.gravity
        touch = R[k] @ load.contact[k, 0]
        hinges = [R[k] @ r + T[k] for r in truth.hinge]
        places = [*hinges, R[k] @ truth.barycentre + T[k], T[k]]
        forces = [*rest.force[k], weight, touch]
        net = np.sum(forces, axis=0)
        moment = R[k] @ load.contact[k, 1] + load.friction[k]
        for place, force in zip(places, forces, strict=True):
            moment = moment + np.cross(place - about, force)
        size = sum(float(np.linalg.norm(f)) for f in forces)
        assert np.linalg.norm(net) < 1e-9 * size
        assert np.linalg.norm(moment) < 1e-9 * size * 3.0  # levers of up to 3 m


@pytest.mark.parametrize("n", [3, 4, 6])
def test_level_symmetrical_terminal_hangs_evenly(n: int) -> None:
    rig = exact_rig(n)
    options = still(postures=1, tilt=0.0, travel=0.0)
    campaign = simulate_campaign(rig, options, np.random.default_rng(0))
    share = 500.0 * 9.80665 / n
    expected = np.array([[0.0, 0.0, share]] * n)
    # The stretch is known to 2 ulp of 1.2 m, times 20 N/µm.
    np.testing.assert_allclose(campaign.force[0], expected, atol=2e7 * 4.5e-16 + 1e-9)


def test_leaning_terminal_shifts_its_load_by_the_lever() -> None:
    rig = exact_rig()
    level = Rotation.from_euler("y", 4.0, degrees=True)
    command = (level.apply(rig.hinge) + np.array([0.0, 0.0, 1.0]))[None]
    campaign = simulate_campaign(rig, still(command=command), np.random.default_rng(0))
    angle = np.deg2rad(4.0)
    # Moments about the line of the back hinges: the front one carries what the barycentre's
    # lever makes it carry, h tan(angle) ahead of the middle; vertical forces but for the
    # horizontal share of the terminal's elastic turning, angle² of it.
    share = 500.0 * 9.80665 * (0.3 + 0.25 * np.tan(angle)) / 0.9
    assert campaign.force[0, 0, 2] == pytest.approx(share, abs=(share - 1634.0) * angle**2 + 0.2)
    assert np.sum(campaign.force[0, :, 2]) == pytest.approx(500.0 * 9.80665, rel=1e-9)


def test_rig_too_soft_to_stand_is_refused() -> None:
    with pytest.raises(NotConvergedError, match="stiffer"):
        simulate_campaign(exact_rig(), still(stiffness=1.0e3), np.random.default_rng(0))


def test_rig_that_would_topple_is_refused() -> None:
    # Level and symmetrical it balances at any height; it stands while the springs' turning
    # stiffness 3/2 k r² exceeds the weight times the barycentre's height above the hinges.
    rig, options = exact_rig(), still(stiffness=1.0e6, postures=1, tilt=0.0, travel=0.0)
    limit = 1.5 * 1.0e6 * 0.36 / (500.0 * 9.80665)
    for height, stands in ((0.98 * limit, True), (1.02 * limit, False)):
        high = np.array([0.0, 0.0, height])
        tower = replace(rig, barycentre=replace(rig.barycentre, value=high))
        if stands:
            simulate_campaign(tower, options, np.random.default_rng(0))
        else:
            with pytest.raises(NotConvergedError, match="stiffer"):
                simulate_campaign(tower, options, np.random.default_rng(0))


def elastic_turning(largest_force: float) -> float:
    """Bound on how far the sprung terminal turns from its command, rad, at 20 N/µm on 0.6 m."""
    return 2.0 * largest_force / 2.0e7 / 0.6


@pytest.mark.parametrize("n", [3, 4, 6])
def test_internal_modes(n: int) -> None:
    rng = np.random.default_rng(n)
    place = rng.normal(size=(n, 3))
    basis = internal_part(place, np.eye(3 * n).reshape(3 * n, n, 3))
    np.testing.assert_allclose(basis.sum(axis=1), 0.0, atol=1e-13)
    np.testing.assert_allclose(np.cross(place, basis).sum(axis=1), 0.0, atol=1e-13)
    projector = basis.reshape(3 * n, 3 * n)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-13)
    assert np.trace(projector) == pytest.approx(3 * n - 6, abs=1e-12)


@pytest.mark.parametrize("n", [3, 4])
def test_squeeze_makes_the_commanded_internal_force(n: int) -> None:
    rig, squeeze = exact_rig(n), 300.0
    slack = simulate_campaign(rig, still(), np.random.default_rng(2))
    tight = simulate_campaign(rig, still(squeeze=squeeze), np.random.default_rng(2))
    commanded = 2.0e7 * tight.postures.displacement
    made = tight.force - slack.force
    turning = elastic_turning(float(np.abs(tight.force).max()))
    scale = np.linalg.norm(commanded, axis=(1, 2)).max()
    np.testing.assert_allclose(made, commanded, atol=2.0 * turning * scale)
    # Σ|F|² / squeeze² over the internal modes is χ² with K (3n − 6) degrees of freedom.
    assert plausible(chi2_p(commanded / squeeze, 24 * (3 * n - 6)))


def test_natural_internal_forces_need_positioning_errors() -> None:
    with pytest.raises(UsageError, match="positioner"):
        simulate_campaign(exact_rig(), Options(internal=100.0), np.random.default_rng(0))
