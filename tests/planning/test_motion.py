"""A planned motion: within its limits, and as certain as it says."""

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import tdfscal
from tdfscal.errors import UsageError
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.planning.candidates import Limits
from tdfscal.planning.motion import MovingPlan, MovingRequest, forecast, plan_motion, usual_motion
from tdfscal.records import FloatArray
from tdfscal.simulation import reference_rig, rotations
from tdfscal.simulation.equilibrium import Pose
from tdfscal.simulation.moving_campaign import Trajectory, simulate_moving
from tdfscal.simulation.options import MovingOptions
from tests.cli.running import Cli
from tests.motioncal.campaigns import DELAY

STIFFNESS = 2.0e7
RIG = reference_rig()
LIMITS = Limits(
    tilt=np.deg2rad(4.0),
    squeeze=200.0,
    travel=np.full((3, 3), 0.06),
    home=np.array([0.05, -0.03, 1.2]),
    stiffness=STIFFNESS,
)
REQUEST = MovingRequest(LIMITS, 24.0, 0.03, 0.11, DELAY)


@cache
def plan() -> MovingPlan:
    return plan_motion(RIG, REQUEST, np.random.default_rng(3))


def time_table(hinge: FloatArray, time: FloatArray, position: FloatArray) -> Trajectory:
    """The motion of a time table: servo positions (N, n, 3), m, BCS, at times (N,), s.

    hinge : (n, 3), m, LCS. Between the rows runs a cubic spline, at rest at both ends.
    """
    middle = hinge.mean(axis=0)
    R = np.stack(
        [rotations.fit_rotation(hinge - middle, row - row.mean(axis=0)) for row in position]
    )
    turn = CubicSpline(time, rotations.log(R), bc_type="clamped")
    way = CubicSpline(time, position, bc_type="clamped")

    def within(at: FloatArray) -> FloatArray:
        return np.clip(at, time[0], time[-1])

    def servo(at: FloatArray) -> FloatArray:
        return np.asarray(way(within(at)))

    def pose(at: FloatArray) -> Pose:
        turned = rotations.exp(turn(within(at)))
        return Pose(turned, servo(at).mean(axis=1) - turned @ middle)

    def nothing(at: FloatArray) -> FloatArray:
        return np.zeros((len(at), 3 * len(hinge) - 6))

    return Trajectory(pose, nothing, servo)


@pytest.mark.slow
def test_every_limit_is_held_and_one_of_them_used() -> None:
    rig = replace(RIG, capacity=np.tile([150.0, 150.0, 2000.0], (3, 1)))
    limits = replace(LIMITS, stiffness=None)
    way = usual_motion(rig, replace(REQUEST, limits=limits, duration=20.0))
    course = way.at(np.linspace(0, 20.0, 2000))
    reading = np.abs(course.carried + course.squeeze)
    sideways = reading[..., :2].max()
    assert 0.9 * 148.0 < sideways <= 0.9 * 150.0 * 1.001
    ends = way.at(np.array([0.0, 20.0]))
    assert ends.rotation == pytest.approx(np.broadcast_to(np.eye(3), (2, 3, 3)), abs=1e-12)
    assert ends.squeeze == pytest.approx(0.0, abs=1e-9)
    total = (course.carried + course.squeeze).sum(axis=1)
    weight = [0.0, 0.0, float(rig.mass.value) * rig.gravity]
    assert total == pytest.approx(np.broadcast_to(weight, total.shape), abs=1e-6)
    used = plan().used
    assert used["tilt"] <= LIMITS.tilt * 1.001
    assert used["speed"] <= REQUEST.speed * 1.001
    assert max(used["travel"]) <= 0.06 * 1.001
    assert used["squeeze"] <= 200.0 * 1.001
    assert used["speed"] > REQUEST.speed * 0.97
    assert used["squeeze"] > 200.0 * 0.97


def test_a_load_cell_stands_aside_and_a_dead_channel_costs() -> None:
    """The forecast of one motion by what the sensors measure."""
    std = []
    for axes in ((True, True, True), (True, False, True), (False, False, True)):
        rig = replace(RIG, axes=np.array([[True] * 3, [True] * 3, axes]))
        found = forecast(usual_motion(rig, REQUEST), np.random.default_rng(1), draws=1)
        std.append(found.rpy_std)
    assert np.isnan(std[2]).tolist() == [[False] * 3, [False] * 3, [True] * 3]
    assert np.all(std[0] < 1.001 * std[1])
    assert std[1][2].max() > 1.1 * std[0][2].max()
    assert np.all(std[1][:2] < 1.001 * std[2][:2])


@pytest.mark.slow
def test_a_machine_that_drives_it_is_as_certain_as_was_said() -> None:
    """Stated σ of six campaigns against the prediction: the draws of the error fields differ."""
    p = plan()
    way = time_table(RIG.hinge, p.time, p.motion.at(p.time).position(p.request.limits))
    options = MovingOptions(
        rate=100.0,
        noise=1.1,
        slow_noise=RIG.declared.force_noise,
        stiffness=(STIFFNESS,) * 3,
        duration=REQUEST.duration,
    )
    variance = []
    for seed in range(6):
        campaign = simulate_moving(RIG, options, np.random.default_rng(seed), way=way)
        result = calibrate_moving(RIG, slow_streams([campaign.log], RIG.capacity), DELAY)
        variance.append(result.uncertainty.rpy_std**2)
    said, reached = (
        float(np.sqrt(np.mean(v))) for v in (p.expected.rpy_std**2, np.array(variance))
    )
    assert reached == pytest.approx(said, rel=0.2)


def test_the_files_and_the_command(tmp_path: Path, cli: Cli) -> None:
    folder = tmp_path / "rig"
    simulate_to_folder(folder, postures=2, rows="postures")
    table = tmp_path / "table.csv"
    command = ["plan", folder, "--motion", "--duration", "20", "--stiffness", "2e7"]
    seen = cli(*command, "-o", table, "-q", ends=0)
    assert "Motion for Reference rig: 20 s without a stop" in seen.out
    rows = [line for line in table.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    read = list(csv.DictReader(rows))
    assert [float(row["t"]) for row in read] == pytest.approx(np.arange(201) * 0.1)
    dx = [float(row["ncp1.dx"]) * 2e7 - float(row["ncp1.squeeze_x"]) for row in read]
    assert dx == pytest.approx([0.0] * 201, abs=0.02)
    with pytest.raises(UsageError, match="of postures"):
        tdfscal.plan(folder, motion=True, postures=8)
