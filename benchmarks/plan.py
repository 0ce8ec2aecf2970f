"""Planned postures against random ones, and against simulated campaigns that drive the plan.

Run: python benchmarks/plan.py > benchmarks/plan.md
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.planning import Limits, Plan, Request, make_plan
from tdfscal.planning.candidates import draw
from tdfscal.planning.choice import Planner
from tdfscal.planning.refinement import refine
from tdfscal.records import Rig
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.simulation import Options, Recorder, make_rig, reference_rig, simulate_dwells

FEW, LONG_SEARCHES, LONG_ROUNDS = 12, 3, 300
TILT, POSTURES, NOISE, CAMPAIGNS = np.deg2rad(6.0), 24, 1.0, 200
STIFF, SOFT = 2.0e7, 2.0e6
#: Squeeze (N), the NCPs' stiffness (N/m) and repeatability (m): their product is the unplanned
#: internal force. A repeatability of 0 stands for NCPs that servo to the forces of the plan.
CASES = (
    (50.0, STIFF, 0.0),
    (200.0, STIFF, 0.0),
    (800.0, STIFF, 0.0),
    (50.0, SOFT, 1e-5),
    (200.0, SOFT, 1e-5),
    (200.0, STIFF, 1e-5),
    (800.0, STIFF, 1e-5),
)


def planned(rig: Rig, squeeze: float, stiffness: float) -> tuple[Plan, float]:
    """A plan and the processor time it took, s."""
    limits = Limits(TILT, squeeze, np.full((3, 3), np.inf), np.zeros(3), stiffness=stiffness)
    start = time.process_time()
    plan = make_plan(rig, Request(limits, noise=NOISE), POSTURES, np.random.default_rng(0))
    return plan, time.process_time() - start


def driven(rig: Rig, plan: Plan, stiffness: float) -> float:
    """Mean rms error of an angle over simulated campaigns, rad."""
    options = Options(command=plan.position, stiffness=stiffness, recorder=Recorder(mean_sd=NOISE))
    batch = simulate_dwells(rig, options, np.random.default_rng(1), CAMPAIGNS)
    errors = [
        so3.to_rpy(fit_robust(rig, postures(rig, batch.dwells(k))).fit.state.rotation)
        - batch.truth.rpy[k]
        for k in range(CAMPAIGNS)
    ]
    return float(np.sqrt(np.mean(np.square(errors), axis=0)).mean())


def searched_long(rig: Rig, request: Request, plan: Plan) -> float:
    """Mean standard uncertainty of an angle, rad, of the best of long searches and the plan."""
    best = float(plan.expected.rpy_std.mean())
    for seed in range(LONG_SEARCHES):
        planner = Planner(rig, request, np.random.default_rng(100 + seed), None)
        index, returns = planner.select(len(plan.position))
        start = planner.pool.take(index)
        if seed:
            anywhere = draw(rig, request.limits, 4 * len(index), planner.rng, extremes=False)
            start = anywhere.take(np.arange(len(index)))
        base = planner.held + len(plan.position) * planner.scatter
        found = refine(
            planner.sight, request.limits, start, base, planner.objective, planner.rng,
            rounds=LONG_ROUNDS,
        )  # fmt: skip
        rows = np.concatenate([np.arange(len(index)), np.zeros(returns, dtype=np.int64)])
        best = min(best, float(planner.forecast(found.take(rows)).rpy_std.mean()))
    return best


def against_long_searches(numbers: tuple[int, ...] = (3, 4, 5, 6)) -> None:
    """Print how far the plans are from the best that long searches find, by number of supports."""
    print(
        f"\n# Against long searches\n\n{FEW} postures, squeeze 200 N, supports on a circle. Long: "
        f"the best of {LONG_SEARCHES} free searches of {LONG_ROUNDS} rounds, one from the pool's "
        "best, the others from\npostures anywhere; standard uncertainty of an angle, mean, mrad.\n"
    )
    print("| supports | plan | long | plan / long | CPU, s |\n|---|---|---|---|---|")
    for n in numbers:
        rig = make_rig(n=n)
        limits = Limits(TILT, 200.0, np.full((n, 3), np.inf), np.zeros(3), stiffness=STIFF)
        request = Request(limits, noise=NOISE)
        start = time.process_time()
        plan = make_plan(rig, request, FEW, np.random.default_rng(0))
        spent = time.process_time() - start
        mine, best = plan.expected.rpy_std.mean(), searched_long(rig, request, plan)
        print(
            f"| {n} | {1e3 * mine:.4f} | {1e3 * best:.4f} | {mine / best:.3f} | {spent:.1f} |",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    print(
        f"# Plans on the reference rig\n\n{POSTURES} postures within ±6°, one of them a return, "
        f"chosen from 1000 candidates; {NOISE:g} N per axis and posture. Mean standard uncertainty "
        f"of an angle, mrad: as the plan promises, of random postures within the same limits (mean "
        f"of 16 sets), and as {CAMPAIGNS} simulated campaigns that drive the plan show it. The "
        "unplanned internal force is repeatability times stiffness, 0 for NCPs that servo to the "
        "forces; where it is as large as the squeeze, random postures get what a plan would add.\n"
    )
    print("| squeeze, N | unplanned, N | plan | random | ratio | simulated | sim./plan | CPU, s |")
    print("|---|---|---|---|---|---|---|---|")
    for squeeze, stiffness, repeatability in CASES:
        rig = reference_rig()
        rig = replace(rig, declared=replace(rig.declared, positioner=repeatability))
        plan, spent = planned(rig, squeeze, stiffness)
        expected, seen = plan.expected.rpy_std.mean(), driven(rig, plan, stiffness)
        print(
            f"| {squeeze:g} | {stiffness * repeatability:g} | {1e3 * expected:.3f} "
            f"| {1e3 * plan.random.rpy_std.mean():.3f} | {plan.improvement:.2f} "
            f"| {1e3 * seen:.3f} | {seen / expected:.3f} | {spent:.1f} |",
            flush=True,
        )
    against_long_searches()


if __name__ == "__main__":
    main()
