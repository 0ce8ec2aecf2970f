"""A plan beats chance, and a simulated campaign confirms what it promises."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.planning.candidates import Request
from tdfscal.planning.plan import Plan, choose, greedy, make_plan, short_tour
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.simulation import Options, Recorder, reference_rig, simulate_dwells

from .limits import limits

RNG = np.random.default_rng
STIFFNESS = 2.0e7


def simulated_mean_std(rig: Rig, plan: Plan, campaigns: int, noise: float) -> float:
    """Mean rms error of an angle over simulated campaigns that drive the plan, rad."""
    options = Options(command=plan.position, stiffness=STIFFNESS, recorder=Recorder(mean_sd=noise))
    batch = simulate_dwells(rig, options, RNG(11), campaigns)
    errors = [
        so3.to_rpy(fit_robust(rig, postures(rig, batch.dwells(k))).fit.state.rotation)
        - batch.truth.rpy[k]
        for k in range(campaigns)
    ]
    return float(np.sqrt(np.mean(np.square(errors), axis=0)).mean())


@pytest.fixture(scope="module")
def reference() -> Plan:
    """24 postures of the reference rig."""
    rig = reference_rig()
    request = Request(limits(rig, squeeze=800.0, stiffness=STIFFNESS), noise=1.0)
    return make_plan(rig, request, 24, RNG(1))


@pytest.mark.slow
def test_a_simulated_campaign_confirms_the_forecast(reference: Plan) -> None:
    campaigns = 56
    # Nine angles, about independent: the mean of their rms errors scatters by 3.2 %.
    scatter = 1 / np.sqrt(2 * 9 * campaigns)
    found = simulated_mean_std(reference_rig(), reference, campaigns, 1.0)
    assert abs(found / reference.expected.rpy_std.mean() - 1) < 0.1
    assert scatter < 0.1 / 3


@pytest.mark.slow
def test_what_stays_unobservable_is_refused() -> None:
    rig = reference_rig()
    # Level and without squeeze, all loads are vertical: no yaw can be seen, nor a share of what is
    # sideways; leaning shows the latter.
    flat, leaning = (limits(rig, tilt_deg=deg, squeeze=0.0) for deg in (0.0, 0.5))
    for bounds, said in (
        (flat, "no angle.*larger squeeze"),
        (leaning, "not determine yaw of ncp1.*do determine roll and pitch of ncp1"),
    ):
        with pytest.raises(NotIdentifiableError, match=said):
            make_plan(rig, Request(bounds, candidates=50), 4, RNG(8))


def test_impossible_requests_are_refused() -> None:
    rig = reference_rig()
    with pytest.raises(UsageError, match="candidates"):
        make_plan(rig, Request(limits(rig), candidates=5), 24, RNG(9))
    with pytest.raises(UsageError, match="0 postures"):
        make_plan(rig, Request(limits(rig), candidates=50), 0, RNG(9))
    silent = replace(rig, declared=replace(rig.declared, force_noise=0.0))
    with pytest.raises(UsageError, match="force noise"):
        make_plan(silent, Request(limits(rig), noise=0.0), 8, RNG(9))


def test_a_target_is_half_a_95_percent_interval() -> None:
    rig = reference_rig()
    request = Request(limits(rig, squeeze=800.0, stiffness=STIFFNESS), noise=1.0, candidates=60)
    few = make_plan(rig, request, None, RNG(1), target=1e-3)
    assert 1.96 * few.expected.largest <= 1e-3
    assert 1.96 * make_plan(rig, request, len(few) - 1, RNG(1)).expected.largest > 0.95e-3


def problem(seed: int, count: int = 9) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(count, 2, 5)) * rng.uniform(0.2, 3.0, (count, 1, 5))
    return J, 0.1 * np.eye(5), rng.normal(size=(3, 5))


def objective(J: FloatArray, base: FloatArray, L: FloatArray, chosen: list[int]) -> float:
    information = base + sum(J[k].T @ J[k] for k in chosen)
    return float(np.trace(L @ np.linalg.inv(information) @ L.T))


@pytest.mark.parametrize("seed", range(3))
def test_exchange_reaches_what_trying_all_sets_finds(seed: int) -> None:
    J, base, L = problem(seed)
    chosen = choose(J, base, L, 4)[0].tolist()
    reached = objective(J, base, L, chosen)
    best = min(objective(J, base, L, list(c)) for c in combinations(range(len(J)), 4))
    assert len(set(chosen)) == 4
    assert reached <= objective(J, base, L, greedy(J, base, L, 4)) * (1 + 1e-12)
    assert reached <= 1.01 * best


def test_the_nearest_posture_comes_next() -> None:
    """Along a line, from its end: in order; by the slowest axis, whose way it is."""
    place = np.zeros((7, 3, 3))
    place[:, 1, 2] = [0.0, 5.0, 1.0, 3.0, 2.0, 6.0, 4.0]
    assert short_tour(place).tolist() == [0, 2, 4, 3, 6, 1, 5]
