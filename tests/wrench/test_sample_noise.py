"""The uncertainty of a single sample: noise of whatever colour, resolution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from tdfscal.model.calibrated import about_point
from tdfscal.model.samples_in_motion import Tally, aligned, still
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Log, Series, UncertainValue
from tdfscal.simulation import Contact, Faults, Options, Recorder, simulate_campaign
from tdfscal.wrench.contact_wrench import at_rest, wrenches
from tdfscal.wrench.filtering import filter_for, filtered
from tdfscal.wrench.wrench_noise import SampleNoise, StopWrenches, take_head, with_sample_noise

from .held_out import RIG, world

WORLD = world(1)
GIVEN = WORLD.given[0]
RATE, POSTURES = 100.0, 12
FORCE = (40.0, -25.0, 60.0)
PHI = 0.95


def noise(kind: str, rng: np.random.Generator, count: int) -> FloatArray:
    """(N, 3, 3), N."""
    white = rng.standard_normal((count, 3, 3))
    if kind == "AR(0.95)":
        return np.asarray(2 * np.sqrt(1 - PHI**2) * lfilter([1.0], [1.0, -PHI], white, axis=0))
    if kind == "hum":
        angle = 2 * np.pi * 49.2 * np.arange(count)[:, None, None] / RATE
        return np.asarray(3 * np.sin(angle + rng.uniform(-3, 3, (3, 3))) + 0.5 * white)
    return np.asarray((0.02 if kind == "resolution" else 2.0) * white)


def log(kind: str, seed: int, touched: int = POSTURES // 2) -> tuple[Log, FloatArray, FloatArray]:
    """A log of the rig that was calibrated, its dwells' begins and ends; the last ones touched."""
    recorder = Recorder(
        dwell=(4.0, 5.0), move=(1.5, 2.0), force_rate=RATE, position_rate=RATE,
        force_sd=(0.0, 0.0),
    )  # fmt: skip
    contacts = tuple(Contact(k, FORCE) for k in range(POSTURES - touched, POSTURES))
    options = Options(
        postures=POSTURES, squeeze=200.0, recorder=recorder, faults=Faults(contacts=contacts)
    )
    rng = np.random.default_rng(seed)
    truth = WORLD.batch.truth
    c = simulate_campaign(RIG, options, rng, truth)
    added = noise(kind, rng, len(c.log.force[0].time))
    force = []
    for i, s in enumerate(c.log.force):
        value = s.value + added[:, i]
        force.append(Series(s.time, np.round(value) if kind == "resolution" else value))
    return replace(c.log, force=tuple(force)), c.start, c.end


def errors(kind: str, seed: int, smoothed: bool = False) -> tuple[FloatArray, SampleNoise]:
    """Errors of the contact wrench over their uncertainty (M, 6), in the dwells."""
    recorded, start, end = log(kind, seed)
    head, samples = take_head(aligned([recorded], Tally()), RIG.supports, averaged=False)
    assert head is not None
    if smoothed:
        samples = filtered(samples, "smooth", filter_for(15.0, head.samples))
    told: list[SampleNoise] = []
    pieces = list(
        with_sample_noise(
            at_rest(GIVEN, samples), head, GIVEN,
            posture_std=0.0, zero_variance=None, tell=told.append,
        )
    )  # fmt: skip
    time = np.concatenate([p.time for p in pieces])
    value = np.concatenate([p.value for p in pieces])
    std = np.concatenate([p.std for p in pieces])
    common = np.concatenate([p.calibration_std for p in pieces])
    assert np.all(common < std)
    found = []
    for k in range(POSTURES):
        rows = (time > start[k] + 0.8) & (time < end[k] - 0.1)
        truth = np.array([*FORCE, 0, 0, 0]) if k >= POSTURES // 2 else np.zeros(6)
        found.append((value[rows] - truth) / std[rows])
    return np.concatenate(found), told[0]


@pytest.mark.parametrize("kind", ["white", "AR(0.95)", "hum", "resolution"])
@pytest.mark.parametrize("smoothed", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_samples_lie_within_their_uncertainty(kind: str, smoothed: bool) -> None:
    found = [errors(kind, seed, smoothed) for seed in (1, 2)]
    assert all(told.dwells >= POSTURES - 4 for _, told in found)
    z = np.concatenate([values for values, _ in found])
    # 24 postures; what does not average out in one (drawn per posture, and common) is a part of
    # u² that a few dozen draws of six components make uncertain by some tenth.
    assert np.mean(np.abs(z) < 1.96) > 0.93
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("turn", "touched", "told"), [(0.0, 0, False), (0.0, 4, False), (0.0, 9, True), (2e-3, 0, True)]
)
def test_a_wrench_at_most_stops_is_told_and_a_touch_at_some_is_not(
    turn: float, touched: int, told: bool
) -> None:
    rotation = GIVEN.state.rotation.copy()
    rotation[1] = so3.exp(np.array([turn, 0.0, 0.0])) @ rotation[1]
    given = replace(GIVEN, state=replace(GIVEN.state, rotation=rotation))
    (piece,) = aligned([log("white", 1, touched)[0]], Tally())
    head, samples = take_head([piece], RIG.supports, averaged=False)
    assert head is not None
    stops, noises = StopWrenches(averaged=False), list[SampleNoise]()
    for found in with_sample_noise(
        at_rest(given, samples), head, given,
        posture_std=0.0, zero_variance=None, tell=noises.append,
    ):  # fmt: skip
        stops.add(found, still(piece))
    assert (stops.beyond(noises[0]) is not None) == told
    if not (turn or touched):
        mean, _, std = stops.means(noises[0])
        assert mean.shape == (POSTURES, 6)
        # White noise alone has a third of this: the rest is what each posture has by itself.
        assert np.mean((mean / std) ** 2) == pytest.approx(1.0, abs=0.3)


def test_moments_about_a_point_are_those_about_the_origin_carried_over() -> None:
    point = np.array([0.2, -0.1, 0.3])
    rig = replace(GIVEN.rig, inertia=UncertainValue.exact(np.diag([60.0, 70.0, 90.0])))
    given = replace(GIVEN, rig=rig)
    dwells = WORLD.held(0)
    here, there = (
        wrenches(g, dwells.start, dwells.position, dwells.force)
        for g in (given, about_point(given, point))
    )
    np.testing.assert_allclose(there.value[:, :3], here.value[:, :3], atol=1e-6)
    carried = here.value[:, 3:] - np.cross(point, here.value[:, :3])
    np.testing.assert_allclose(there.value[:, 3:], carried, atol=1e-6)
    # Steiner, from the barycentre: the inertia there does not depend on the origin.
    moved, m = about_point(given, point), float(GIVEN.state.mass)
    assert moved.rig.inertia is not None
    for g in (given, moved):
        r = g.state.barycentre
        assert g.rig.inertia is not None
        central = g.rig.inertia.value - m * (r @ r * np.eye(3) - np.outer(r, r))
        r0 = GIVEN.state.barycentre
        expected = np.diag([60.0, 70.0, 90.0]) - m * (r0 @ r0 * np.eye(3) - np.outer(r0, r0))
        np.testing.assert_allclose(central, expected, atol=1e-9)
