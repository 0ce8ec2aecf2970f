"""Alarms of a rig's history: what is named, when, and how often for nothing.

Histories are drawn from the model itself (linear, Gaussian), so that rates are exact; what the
estimator makes of simulated campaigns is in `test_pooling.py`.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

from tdfscal.comparison.control_chart import WINDOWS, Check, Watching
from tdfscal.comparison.history import Life, live, turn_suspected, turns_visible
from tdfscal.model.calibrated import free_constants
from tdfscal.model.parameters import nominal
from tdfscal.numerics.information import Information
from tdfscal.records import Drift, FloatArray, Rig
from tdfscal.significance import DETECTION_POWER
from tdfscal.simulation import reference_rig

SENSORS, HINGES = 3, 4
SIZE = 3 * SENSORS + HINGES
#: What one check sees of a turn, rad; what the hinges' coordinates are known to, m.
SEEN, KNOWN = 3e-4, 2e-5
PRIOR = Information(np.diag([1e-4] * 3 * SENSORS + [KNOWN**-2] * HINGES), np.zeros(SIZE))


def watched(
    rng: np.random.Generator, turns: FloatArray, *, rate: float = 0.01, gap: float = 1.0
) -> Watching:
    """Go through checks of a rig whose sensors are turned by turns (months, 9), rad."""
    truth = np.concatenate([np.zeros(3 * SENSORS), KNOWN * rng.standard_normal(HINGES)])
    checks = []
    for k, turn in enumerate(turns):
        J = rng.standard_normal((14, SIZE)) / SEEN / 2
        J[:, 3 * SENSORS :] *= SEEN / KNOWN
        x = truth.copy()
        x[: 3 * SENSORS] += turn
        reading = J @ x + rng.standard_normal(len(J))
        checks.append(Check(str(k), gap * k, Information(J.T @ J, J.T @ reading)))
    steps = [np.zeros(SIZE)] * len(checks)
    return Watching(checks, PRIOR, steps, SENSORS, rate).run()


def turned(months: int, at: int, sensor: int, turn: FloatArray) -> FloatArray:
    turns = np.zeros((months, 3 * SENSORS))
    turns[at:, 3 * sensor : 3 * sensor + 3] = turn
    return turns


@pytest.mark.parametrize("size", [3e-3, 0.02, 0.3])
def test_a_step_is_named_with_sensor_and_month(size: float) -> None:
    """Of a heavy one χ² of other sensors is beyond all probability too: p = 0 names none."""
    found = watched(np.random.default_rng(8), turned(9, 7, 2, np.array([0.0, size, 0.0])))
    (alarm,) = found.alarms
    assert (alarm.kind, alarm.sensor, alarm.raised, alarm.onset) == ("step", 2, 7, 7)
    assert np.abs(alarm.turn - [0.0, size, 0.0]).max() < 4 * alarm.std.max()


def test_the_date_of_a_small_step_is_told_by_what_came_after() -> None:
    """One check hardly shows a turn of 0.85 mrad; in most of ten histories its date is right."""
    rng, right = np.random.default_rng(9), 0
    for _ in range(10):
        alarms = watched(rng, turned(24, 10, 1, np.array([6e-4, 0.0, 6e-4]))).alarms
        right += any(a.kind == "step" and a.sensor == 1 and a.onset == 10 for a in alarms)
    assert right >= 7


def test_creep_is_told_from_a_step() -> None:
    rng, called = np.random.default_rng(3), []
    for _ in range(8):
        slope = 2e-4 * np.array([1.0, 0.0, 0.0])
        turns = np.zeros((24, 3 * SENSORS))
        turns[:, 3:6] = np.arange(24)[:, None] * slope
        alarms = watched(rng, turns, rate=1e-4).alarms
        assert alarms[0].sensor == 1
        called.append(alarms[0].kind)
    assert called.count("creep") >= 5


@pytest.mark.parametrize("gap", [1.0, pytest.param(1 / 30.4375, marks=pytest.mark.slow)])
def test_the_rate_of_false_alarms_is_kept_whatever_the_interval(gap: float) -> None:
    """A third of sound rig-years at most is to alarm at a rate of 0.4; half of it is too few."""
    rng, months, histories = np.random.default_rng(5), 13, 60
    years = (months - 1) * gap / 12
    rate = 0.4 / years
    still = np.zeros((months, 3 * SENSORS))
    wrong = sum(bool(watched(rng, still, rate=rate, gap=gap).alarms) for _ in range(histories))
    expected = histories * (1 - np.exp(-0.4))
    assert 0.25 * expected < wrong < expected + 2.6 * np.sqrt(expected)


def lived(
    turns: FloatArray, rig: Rig | None = None, noise: float = 0.0, seed: int = 0, gap: float = 1.0
) -> Life:
    """Life of checks `gap` months apart that see turns (K, 9), rad, each with 0.3 mrad."""
    rig = rig or reference_rig()
    size, rng = int(free_constants(rig).sum()), np.random.default_rng(seed)
    own = np.zeros((size, size))
    own[:9, :9] = np.eye(9) / SEEN**2
    prior = Information(np.diag([1e-4] * 9 + [KNOWN**-2] * (size - 9)), np.zeros(size))
    checks = []
    for k, turn in enumerate(turns):
        seen = np.zeros(size)
        seen[:9] = turn + noise * SEEN * rng.standard_normal(9)
        checks.append(Check(str(k), gap * k, Information(own, own @ seen)))
    return live(rig, nominal(rig), prior, checks, rate=0.01)


def test_the_smallest_step_is_the_one_that_the_last_check_shows_so_often() -> None:
    """Closed form: χ² of a turn between two checks that each see it alike."""
    life = lived(np.zeros((2, 9)))
    level = 0.01 / 12 * WINDOWS[1] / SENSORS
    seen = ncx2.sf(chi2.isf(level, 3), 3, (life.detectable / SEEN) ** 2 / 2)
    np.testing.assert_allclose(seen, DETECTION_POWER, rtol=1e-3)


@pytest.mark.parametrize(("p", "told"), [(0.0099, True), (0.0101, False), (1e-5, False)])
def test_a_turn_below_the_alarm_is_suspected_at_the_level_of_a_comparison(
    p: float, told: bool
) -> None:
    """And not where the alarm is raised."""
    turns = np.zeros((2, 9))
    turns[1, 3] = SEEN * np.sqrt(2 * chi2.isf(p / SENSORS, 3))
    life = lived(turns, noise=0.0)
    found = {finding.code: finding for finding in (*turn_suspected(life, 1), *turns_visible(life))}
    assert found["turns-visible"].size == life.detectable.max()
    assert ("turn-suspected" in found) is told
    if told:
        assert found["turn-suspected"].subject == life.supports[1:2]
        assert found["turn-suspected"].p_value == pytest.approx(p, rel=1e-3)


def test_a_creep_sets_the_date_of_the_next_calibration() -> None:
    """At 0.2 mrad a month the limit of 5 mrad is 25 months away, and no longer than that."""
    rig, pace = reference_rig(), 2e-4
    turns = np.zeros((24, 9))
    turns[:, 3] = pace * np.arange(24)
    life = lived(turns)
    assert (life.alarms[-1].kind, life.due.sensor) == ("creep", 1)
    assert life.due.month is not None
    wait = rig.acceptance.angle_std / pace
    assert 0.7 * wait < life.due.month - 23 < wait


def test_a_walk_is_foreseen_by_its_upper_bound() -> None:
    """Of 1 mrad/√month: the uncertainty meets 5 mrad before 25 months, at the most allowed."""
    walk = 1e-3 * np.random.default_rng(3).standard_normal((24, 9))
    rig = replace(reference_rig(), drift=Drift(angle=8e-4))
    life = lived(np.cumsum(walk, axis=0), rig)
    assert not life.alarms
    assert life.walk is not None
    assert life.due.month is not None
    room = rig.acceptance.angle_std**2 - life.due.now**2
    assert life.due.month - 23 == pytest.approx(room / life.walk.high**2, rel=1e-9)
    assert life.due.month - 23 < room / 1e-3**2
