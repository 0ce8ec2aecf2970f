"""A planned motion against its prediction and against the usual one, by simulated campaigns.

    python -m benchmarks.motion_plan [--runs 30] [--stiffness 2e7]

The usual motion is the simulator's random multisine; the plan gets the same time and, as its
limits, the means of what that uses of lean, speed, travel and internal force. Both are driven on
the same machines, recorded alike and calibrated alike.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.interpolate import CubicSpline

from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.planning.limits import Limits
from tdfscal.planning.moving_information import MovingRequest
from tdfscal.planning.moving_plan import MovingPlan, plan_motion
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.simulation import reference_rig, rotations
from tdfscal.simulation.equilibrium import Pose
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.moving_options import MovingOptions
from tdfscal.simulation.postures import internal_part
from tdfscal.simulation.trajectories import Trajectory, draw_trajectory

DELAY = UncertainValue(np.array(0.0), np.array(0.02))


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


def used(rig: Rig, options: MovingOptions, draws: int = 20) -> FloatArray:
    """Lean (rad), speed (m/s), internal force (N) and travel (3,) (m) of random motions, mean."""
    found = []
    time = np.arange(0.0, options.duration, 0.1)
    for seed in range(draws):
        way = draw_trajectory(options, rig.n, np.random.default_rng(seed))
        pose = way.pose(time)
        place = pose.place(rig.hinge)
        middle = np.broadcast_to(place.mean(axis=0), (3 * rig.n, rig.n, 3))
        basis = internal_part(middle, np.eye(3 * rig.n).reshape(-1, rig.n, 3))
        modes = np.linalg.eigh(basis.reshape(3 * rig.n, -1))[1][:, 6:]
        force = internal_part(place, (way.squeeze(time) @ modes.T).reshape(-1, rig.n, 3))
        away = np.abs(place - (rig.hinge + np.asarray(options.home))).max(axis=(0, 1))
        speed = np.linalg.norm(np.diff(place, axis=0), axis=2).max() / 0.1
        lean = np.arccos(pose.rotation[:, 2, 2]).max()
        found.append([lean, speed, np.linalg.norm(force, axis=2).max(), *away])
    return np.asarray(np.mean(found, axis=0), dtype=np.float64)


def row(
    name: str, plan: MovingPlan | None, way: Trajectory | None, o: MovingOptions, runs: int
) -> str:
    """Drive and calibrate; one row of the table."""
    rig = reference_rig()
    error, std, distance = [], [], []
    for seed in range(runs):
        campaign = simulate_moving(rig, o, np.random.default_rng(seed), way=way)
        result = calibrate_moving(rig, slow_streams([campaign.log], rig.capacity), DELAY)
        back = np.swapaxes(result.fit.state.still.rotation, 1, 2)
        e = so3.log(campaign.truth.rotation @ back).ravel()
        C = result.uncertainty.turns.covariance
        error.append(e)
        std.append(np.sqrt(np.diagonal(C)))
        distance.append(float(e @ np.linalg.solve(C, e)) / len(e))
    rmse, stated = (1e3 * np.sqrt(np.mean(np.square(v))) for v in (error, std))
    said = "" if plan is None else f"{1e3 * np.sqrt(np.mean(plan.expected.rpy_std**2)):.3f}"
    spread = np.std(distance) / np.sqrt(runs)
    return (
        f"| {name} | {runs} | {said} | {stated:.3f} | {rmse:.3f} | "
        f"{np.mean(distance):.2f} ± {spread:.2f} |"
    )


def main() -> None:
    """Print the table's rows."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--stiffness", type=float, default=2e7)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    rig, K = reference_rig(), chosen.stiffness
    options = MovingOptions(
        rate=100.0, noise=1.1, slow_noise=rig.declared.force_noise, stiffness=(K, K, K)
    )
    lean, speed, force, *travel = used(rig, options)
    limits = Limits(lean, force, np.tile(travel, (rig.n, 1)), np.asarray(options.home), stiffness=K)
    request = MovingRequest(limits, options.duration, speed, 0.11, DELAY)
    plan = plan_motion(rig, request, np.random.default_rng(chosen.seed))
    way = time_table(
        rig.hinge, plan.time, plan.trajectory.at(plan.time).position(plan.request.limits)
    )
    print(row(f"plan, {K:g} N/m", plan, way, options, chosen.runs))
    print(row(f"usual, {K:g} N/m", None, None, options, chosen.runs))


if __name__ == "__main__":
    main()
