"""Parameters by their definitions: order, priors, and how a state is moved."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.model.parameters import (
    EVEN_TURN,
    State,
    constants,
    deviation,
    layout,
    nominal,
    parameter_count,
    prior_std,
    retract,
    rpy_prior_std,
    starting_state,
    vector,
)
from tdfscal.model.postures import ZeroMotion
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, FloatArray, JointPrior, Rig, UncertainValue

RNG = np.random.default_rng(17)
DECLARED = DeclaredUncertainty(
    positioner=1e-5,
    hinge=2e-5,
    datum=3e-5,
    force_noise=0.1,
    force_sensitivity=1e-3,
    hinge_moment=0.05,
    compliance_lateral=1e-9,
    compliance_vertical=2e-9,
)
RIG = replace(
    simulation.make_rig(4),
    declared=DECLARED,
    gravity_tilt_std=4e-4,
    zero=UncertainValue(RNG.normal(size=(4, 3)), RNG.uniform(1, 2, (4, 3))),
    nominal_rpy=RNG.normal(size=(4, 3)),
)


def state(motions: int = 2) -> State:
    """A state of four supports away from every special value."""
    return retract(nominal(RIG, motions), 0.1 * RNG.normal(size=parameter_count(4, motions)))


def test_a_step_moves_each_quantity_by_its_own_part() -> None:
    base, step = state(), 0.1 * RNG.normal(size=parameter_count(4, 2))
    moved, place = retract(base, step), layout(4, 2)
    for i in range(4):
        turn = step[3 * i : 3 * i + 3]
        assert np.allclose(moved.rotation[i], so3.exp(turn) @ base.rotation[i], rtol=0, atol=1e-14)
    for name in list(place)[1:]:
        difference = np.ravel(getattr(moved, name) - getattr(base, name))
        assert np.allclose(difference, step[place[name]], rtol=0, atol=1e-12), name
    assert np.allclose(deviation(moved, base), step, rtol=0, atol=1e-11)
    assert not vector(base)[:12].any()


def stds(rig: Rig, motion: ZeroMotion | None = None) -> dict[str, FloatArray]:
    motions = 0 if motion is None else len(motion.std)
    return {k: prior_std(rig, motion)[place] for k, place in layout(rig.n, motions).items()}


def test_priors_are_what_the_rig_file_declares() -> None:
    std = stds(RIG)
    assert np.isinf(std["rotation"]).all()
    assert np.array_equal(std["zero"], RIG.zero.std.ravel())
    assert (std["mass"], *std["barycentre"]) == (RIG.mass.std, *RIG.barycentre.std)
    for name, value in (("hinge", 2e-5), ("datum", 3e-5), ("tilt", 4e-4)):
        assert (std[name] == value).all(), name
    assert np.array_equal(std["compliance"], [1e-9, 2e-9])
    assert std["drift"].size == 0
    # n hinges of one direction are as long as n independent moments per axis: (n τ)² = 3 · 0.05².
    assert 4 * std["friction"][0] == pytest.approx(np.sqrt(3) * 0.05, rel=1e-14)


def test_sensitivity_prior_is_that_of_a_symmetrised_matrix() -> None:
    E = 1e-3 * np.random.default_rng(0).normal(size=(200_000, 3, 3))
    S = (E + np.swapaxes(E, 1, 2)) / 2
    drawn = S[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]].std(axis=0)
    stated = stds(RIG)["sensitivity"].reshape(4, 6)
    assert np.abs(drawn / stated - 1).max() < 5 / np.sqrt(2 * 200_000)


def test_a_sensor_without_all_axes_has_a_turn_spread_over_the_circle() -> None:
    axes = np.ones((4, 3), dtype=np.bool_)
    axes[1, 2] = axes[2, 0] = False
    stated = np.full((4, 3), np.inf)
    stated[2, 1] = 0.01
    std = rpy_prior_std(replace(RIG, axes=axes, rpy_std=stated))
    uniform = np.random.default_rng(1).uniform(-np.pi, np.pi, 400_000).std()
    assert pytest.approx(uniform, rel=5e-3) == EVEN_TURN
    assert np.array_equal(std[1], np.full(3, EVEN_TURN))
    assert np.array_equal(std[2], [EVEN_TURN, 0.01, EVEN_TURN])
    assert np.isinf(std[[0, 3]]).all()


def earlier() -> tuple[Rig, State]:
    """A rig with knowledge of an earlier campaign, and that campaign's estimate."""
    estimate = state(0)
    root = np.eye(parameter_count(4))[constants(4)]
    prior = JointPrior(estimate.rotation, vector(estimate), root, 0.0, 0)
    return replace(RIG, earlier=prior), estimate


def test_constants_start_where_an_earlier_campaign_left_them() -> None:
    rig, estimate = earlier()
    start = starting_state(rig, 2)
    assert np.allclose(start.rotation, estimate.rotation, rtol=0, atol=1e-14)
    for name in ("sensitivity", "mass", "barycentre", "hinge", "datum", "tilt", "compliance"):
        assert np.allclose(getattr(start, name), getattr(estimate, name), atol=1e-14), name
    stated = nominal(rig)
    for name in ("zero", "friction"):
        assert np.array_equal(getattr(start, name), getattr(stated, name)), name
    assert start.drift.shape == (2, 4, 3)
    assert starting_state(rig).drift.shape == starting_state(RIG).drift.shape == (0, 4, 3)
    alone = starting_state(RIG, 2)
    assert np.array_equal(alone.rotation, stated.rotation)
    assert np.array_equal(vector(alone), vector(nominal(RIG, 2)))


def test_constants_known_from_earlier_have_no_prior_of_their_own() -> None:
    rig, _ = earlier()
    own, known, place = prior_std(RIG), prior_std(rig), constants(4)
    assert np.isinf(known[place]).all()
    assert np.array_equal(known[~place], own[~place])
    assert rig.earlier is not None
    root = rig.earlier.root.copy()
    root[:, layout(4)["datum"]] = 0.0  # as of a rig whose datums are exact
    exact = replace(rig.earlier, root=root)
    std = prior_std(replace(rig, earlier=exact, declared=replace(DECLARED, datum=0.0)))
    assert not std[layout(4)["datum"]].any()
