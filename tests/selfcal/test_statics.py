"""The measurement model against the simulator's physics, and its Jacobians by other routes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.estimation.observability import noise_pull
from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.parameters import State, deviation, layout, nominal, retract
from tdfscal.model.statics import balance, features, features_jacobian, postures
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, Drift, FloatArray, Rig
from tdfscal.selfcal.estimator import fit
from tdfscal.selfcal.score_tests import best_variance, suspicions
from tdfscal.simulation import Options, Recorder, make_rig, reference_rig, simulate_dwells

EXACT = DeclaredUncertainty()


def exact_rig(n: int = 3) -> Rig:
    """A rig that is exactly what its file says, but for zeros, mass and barycentre."""
    return replace(simulation.make_rig(n), declared=EXACT)


def true_state(rig: Rig, truth: simulation.Truth) -> State:
    """The simulator's truth in the estimator's parameters."""
    return replace(
        nominal(rig),
        rotation=truth.rotation,
        zero=truth.zero,
        mass=np.asarray(truth.mass),
        barycentre=truth.barycentre,
        sensitivity=truth.sensitivity[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
    )


@pytest.mark.parametrize("n", [3, 4, 6])
def test_the_simulators_equilibrium_balances(n: int) -> None:
    """At the truth, e is zero up to the elastic deflection that no servo shows.

    A stiffness of 1e9 N/m leaves deflections of micrometres under loads of some 10³ N.
    """
    rig = replace(exact_rig(n), declared=replace(EXACT, force_sensitivity=0.01))
    options = Options(stiffness=1e9, squeeze=300.0, recorder=Recorder(mean_sd=0.0, encoder_sd=0.0))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(5), 1)
    truth = batch.truth.trial(0)
    seen = postures(rig, batch.dwells(0))
    state = true_state(rig, truth)
    at = balance(
        replace(seen, force_cov=seen.force_cov + np.eye(3)), state, np.zeros(3), rig.gravity
    )
    e = at.design @ features(state, at, rig.gravity)
    load = float(truth.mass) * rig.gravity
    assert np.abs(e[:, :3]).max() < 1e-9 * load
    # Lever arms are off by the rotation of the pose that deflections of load/stiffness make.
    assert np.abs(e[:, 3:]).max() < load**2 / 1e9
    off = features(replace(state, rotation=so3.exp([1e-3, 0, 0]) @ state.rotation), at, rig.gravity)
    assert np.abs(at.design @ off).max() > 1.0  # a milliradian is newtons: the check can fail


def random_state(rig: Rig, rng: np.random.Generator) -> State:
    """A state away from every special value."""
    n = rig.n
    sizes = {"rotation": 0.3, "zero": 2, "sensitivity": 0.02, "mass": 3, "barycentre": 0.02}
    sizes |= {"tilt": 1e-2, "compliance": 1e-7, "drift": 1.0}
    motions = int(rig.drift.time > 0) + int(rig.drift.parabola > 0)
    place = layout(n, motions)
    step = np.zeros(place["drift"].stop)
    for name, size in sizes.items():
        step[place[name]] = size * rng.normal(size=place[name].stop - place[name].start)
    return retract(nominal(rig, motions), step)


@pytest.mark.parametrize("n", [3, 5])
def test_features_jacobian_by_complex_step(n: int) -> None:
    rng = np.random.default_rng(n)
    rig = replace(simulation.make_rig(n), drift=Drift(time=1.0, parabola=1.0))
    batch = simulation.simulate_dwells(rig, Options(), rng, 1)
    state = random_state(rig, rng)
    at = balance(postures(rig, batch.dwells(0)), state, np.array([0.0, 0.1, 0.2]), rig.gravity)
    jac = features_jacobian(state, at, rig.gravity)
    h = 1e-30
    for j, unit in enumerate(np.eye(jac.shape[1])):
        step: Any = 1j * h * unit
        moved: Any = features(retract(state, step), at, rig.gravity)
        scale = max(1.0, float(np.abs(jac[:, j]).max()))
        assert np.abs(moved.imag / h - jac[:, j]).max() < 1e-13 * scale, j


def test_columns_of_the_geometry_by_differences() -> None:
    """The linearised corrections of hinges, datums and compliance against balances formed anew.

    The positions are rigid to the last digit here, as the columns assume to first order.
    """
    rng = np.random.default_rng(2)
    rig = exact_rig()
    options = Options(recorder=Recorder(mean_sd=0.5, encoder_sd=0.0))
    seen = postures(rig, simulation.simulate_dwells(rig, options, rng, 1).dwells(0))
    state, centre, g = nominal(rig), np.array([0.0, 0.1, 0.2]), rig.gravity

    def residual(s: State) -> FloatArray:
        at = balance(seen, s, centre, g)
        return np.asarray(at.design @ features(s, at, g))

    at = balance(seen, state, centre, g)
    jac = at.design @ features_jacobian(state, at, g)
    place = layout(3)
    for j in [*range(place["hinge"].start, place["datum"].stop),
              *range(place["compliance"].start, place["compliance"].stop)]:  # fmt: skip
        h = 1e-5 if j < place["datum"].stop else 1e-8
        step = h * np.eye(jac.shape[2])[j]
        difference = (residual(retract(state, step)) - residual(retract(state, -step))) / (2 * h)
        assert np.abs(difference - jac[:, :, j]).max() < 1e-6 * np.abs(jac[:, :, j]).max()


@pytest.mark.parametrize(
    ("noise", "positioner"), [(2.0, 1.0e-5), (0.02, 3.0e-5)], ids=["forces", "positions"]
)
def test_noise_makes_no_gain_however_many_the_postures(noise: float, positioner: float) -> None:
    declared = DeclaredUncertainty(
        positioner=positioner,
        hinge=2.0e-5,
        force_noise=0.01,
        force_sensitivity=5.0e-3,
        compliance_lateral=5.0e-8,  # what gives in the simulator
        compliance_vertical=5.0e-8,
    )
    rig = make_rig(declared=declared)
    options = Options(postures=3000, squeeze=200.0, recorder=Recorder(mean_sd=noise))
    batch = simulate_dwells(rig, options, np.random.default_rng(3), 1)
    truth, seen = true_state(rig, batch.truth.trial(0)), postures(rig, batch.dwells(0))
    known = estimate(fit(rig, seen, truth))
    std = known.uncertainty.parameter_std
    free = std > 0
    off = deviation(known.fit.state, truth)[free] / std[free]
    assert np.abs(off).max() < 4.0
    assert known.quality.p_value > 1e-3
    assert not suspicions(known, np.arange(len(seen), dtype=np.float64))
    # Negative control: so far would noise have pulled the gains.
    root, pull = known.parts.root, known.fit.noise_pull[free]
    shift = np.zeros(len(std))
    shift[free] = root @ (root.T @ pull) / std[free]
    assert np.abs(shift[layout(3)["sensitivity"]]).max() > 4.5


def test_the_pull_of_noise_is_what_small_changes_of_readings_and_positions_make() -> None:
    """Σ (∂Φ/∂ν)ᵀ W cov(ν) (∂e/∂ν) by differences, reading by reading and position by position."""
    rig, rng = reference_rig(), np.random.default_rng(1)
    options = Options(postures=12, squeeze=50.0, recorder=Recorder(mean_sd=1.0))
    batch = simulate_dwells(rig, options, rng, 1)
    seen, state = postures(rig, batch.dwells(0)), true_state(rig, batch.truth.trial(0))
    at, weight = balance(seen, state, rig.barycentre.value, rig.gravity), rng.uniform(0.5, 1, 12)
    W, expected = at.information * weight[:, None, None], 0.0
    by_place = (at.noise_turn[:, None] @ at.turn) @ seen.position_cov
    for name, step, gain in (
        ("force", 1.0, at.noise_force @ seen.force_cov),
        ("position", 1e-5, by_place),
    ):
        for i, a in np.ndindex(rig.n, 3):
            designs = []
            for sign in (step, -step):
                moved = getattr(seen, name).copy()
                moved[:, i, a] += sign
                other = replace(seen, **{name: moved})
                designs.append(balance(other, state, at.centre, rig.gravity).design)
            slope = (designs[0] - designs[1]) / (2 * step)
            expected = expected + np.einsum("kaq,kab,kb->q", slope, W, gain[:, i, :, a])
    found = noise_pull(at, state, W)
    scale = np.linalg.norm(at.whitener @ at.design, axis=(0, 1))
    assert np.allclose(
        found / scale, expected / scale, rtol=0, atol=1e-7 * np.abs(found / scale).max()
    )


def test_what_the_parameters_follow_asks_for_no_variance() -> None:
    """Of nine columns the parameters follow eight: the ninth alone speaks, by a closed form."""
    square = 6.25
    white = np.array([[0.0] * 8 + [np.sqrt(square), 0.0, 0.0, 0.0]])
    theta, gain = best_variance(np.eye(12, 9)[None], white, np.eye(12, 8)[None])
    assert theta == pytest.approx(square - 1, rel=1e-3)
    assert gain == pytest.approx(square - 1 - np.log(square), rel=1e-6)
