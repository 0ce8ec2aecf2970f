"""Each fault moves what it should, and nothing else."""

from functools import cache

import numpy as np
import pytest

from tdfscal.records import FloatArray
from tdfscal.simulation import (
    SCENARIOS,
    Campaign,
    Contact,
    Drift,
    Faults,
    Gain,
    Options,
    Run,
    ZeroShift,
    make_rig,
    reference_rig,
    run,
    simulate_campaign,
)

K = 6


def campaign(faults: Faults | None = None) -> Campaign:
    options = Options(postures=K, faults=faults or Faults())
    return simulate_campaign(reference_rig(), options, np.random.default_rng(0))


def readings(c: Campaign) -> FloatArray:
    return np.stack([s.value for s in c.log.force], axis=1)


def places(c: Campaign) -> FloatArray:
    return np.stack([s.value for s in c.log.position], axis=1)


PLAIN = campaign()
TIME = PLAIN.log.force[0].time


def change(faults: Faults) -> FloatArray:
    faulty = campaign(faults)
    np.testing.assert_array_equal(faulty.servo, PLAIN.servo)
    return readings(faulty) - readings(PLAIN)


def test_zero_shift() -> None:
    moved = change(Faults(zero_shifts=(ZeroShift(1, 3, (5.0, -4.0, 3.0)),)))
    before, after = PLAIN.end[2], PLAIN.start[3]
    np.testing.assert_array_equal(moved[:, [0, 2]], 0.0)
    np.testing.assert_array_equal(moved[before >= TIME], 0.0)
    late = moved[after <= TIME, 1]
    np.testing.assert_allclose(late, np.broadcast_to([5.0, -4.0, 3.0], late.shape), atol=1e-11)


def test_drift() -> None:
    moved = change(Faults(drifts=(Drift(0, (10.0, 0.0, -5.0)),)))
    np.testing.assert_array_equal(moved[:, 1:], 0.0)
    expected = TIME[:, None] / PLAIN.end[-1] * [10.0, 0.0, -5.0]
    np.testing.assert_allclose(moved[:, 0], expected, atol=1e-11)


def test_gain_and_crosstalk() -> None:
    faulty = campaign(Faults(gains=(Gain(0, (0.1, 0.0, 0.0)),)))
    truth = faulty.truth
    np.testing.assert_allclose(
        truth.sensitivity[0] - PLAIN.truth.sensitivity[0], np.diag([0.1, 0.0, 0.0])
    )
    faulty = campaign(Faults(gains=(Gain(2, crosstalk=(0.01, 0.02, 0.03)),)))
    moved = readings(faulty) - readings(PLAIN)
    np.testing.assert_array_equal(moved[:, :2], 0.0)
    k = np.searchsorted(TIME, PLAIN.start[2])
    seen = truth.rotation[2].T @ PLAIN.force[2, 2]
    expected = [0.01 * seen[1] + 0.02 * seen[2], 0.01 * seen[0] + 0.03 * seen[2],
                0.02 * seen[0] + 0.03 * seen[1]]  # fmt: skip
    late = k + 200  # the settling, a real force, passes through the crosstalk too
    np.testing.assert_allclose(moved[late, 2], expected, atol=1e-3)


def test_contact_touches_its_posture_and_the_moves_beside_it() -> None:
    moved = change(Faults(contacts=(Contact(2, (0.0, 0.0, 60.0)),)))
    away = (PLAIN.end[1] >= TIME) | (PLAIN.start[3] <= TIME)
    np.testing.assert_allclose(moved[away], 0.0, atol=1e-6)  # the solver's balance, on 5 kN
    there = (PLAIN.start[2] <= TIME) & (PLAIN.end[2] >= TIME)
    total = np.einsum("nij,knj->ki", PLAIN.truth.rotation, moved[there])
    push = PLAIN.postures.pose.rotation[2] @ [0.0, 0.0, 60.0]
    # Sensitivities are exact; the real rotation differs from the commanded one by under 1 mrad.
    np.testing.assert_allclose(total, np.broadcast_to(-push, total.shape), atol=0.06)


def test_saturation_clips_at_the_stated_capacity() -> None:
    played = run(make_rig(), "saturation", Options(postures=K), np.random.default_rng(0))
    plain = run(make_rig(), "self", Options(postures=K), np.random.default_rng(0))
    assert played.campaign is not None
    assert plain.campaign is not None
    clipped, whole = readings(played.campaign), readings(plain.campaign)
    capacity = played.rig.capacity
    assert np.all(np.isfinite(capacity))
    assert np.any(np.abs(whole) > capacity)
    np.testing.assert_array_equal(clipped, np.clip(whole, -capacity, capacity))


@cache
def squeezed(scenario: str) -> Run:
    options = Options(postures=K, squeeze=100.0)
    return run(reference_rig(), scenario, options, np.random.default_rng(0))


@pytest.mark.parametrize("name", [n for n in SCENARIOS if n not in ("self", "tracker")])
def test_every_scenario_is_the_same_machine_with_one_fault(name: str) -> None:
    plain, faulty = squeezed("self"), squeezed(name)
    np.testing.assert_array_equal(plain.truth.rotation, faulty.truth.rotation)
    assert plain.survey is not None
    assert faulty.survey is not None
    np.testing.assert_array_equal(plain.survey.session.moves.xyz, faulty.survey.session.moves.xyz)
    assert plain.campaign is not None
    assert faulty.campaign is not None
    # A positioner's frame that is turned shows in its own positions alone.
    seen = places if name == "turned-frame" else readings
    assert np.any(seen(plain.campaign) != seen(faulty.campaign))
