"""Planned postures against random ones, and against simulated campaigns that drive the plan.

Run: python benchmarks/plan.py > benchmarks/plan.md
"""

from __future__ import annotations

import time

import numpy as np

from tdfscal.numerics import so3
from tdfscal.planning import Limits, Plan, Request, make_plan
from tdfscal.records import Rig
from tdfscal.robust import fit_robust
from tdfscal.simulation import Options, Recorder, reference_rig, simulate_dwells
from tdfscal.statics import postures

TILT, POSTURES, NOISE, CAMPAIGNS = np.deg2rad(6.0), 24, 1.0, 200
#: Squeeze (N) and the NCPs' stiffness (N/m): soft NCPs make few unplanned internal forces.
CASES = ((50.0, 2.0e6), (200.0, 2.0e6), (200.0, 2.0e7), (800.0, 2.0e7))


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
        so3.to_rpy(fit_robust(rig, postures(rig, batch.dwells(k)))[0].state.rotation)
        - batch.truth.rpy[k]
        for k in range(CAMPAIGNS)
    ]
    return float(np.sqrt(np.mean(np.square(errors), axis=0)).mean())


def main() -> None:
    """Print the table."""
    rig = reference_rig()
    print(
        f"# Plans on the reference rig\n\n{POSTURES} postures within ±6°, one of them a return, "
        f"chosen from 1000 candidates; {NOISE:g} N per axis and posture. Mean standard uncertainty "
        f"of an angle, mrad: as the plan promises, of random postures within the same limits (mean "
        f"of 16 sets), and as {CAMPAIGNS} simulated campaigns that drive the plan show it. 10 µm "
        "of repeatability times the stiffness is the unplanned internal force, which helps random "
        "postures as well.\n"
    )
    print(
        "| squeeze, N | stiffness, N/µm | plan | random | ratio | simulated | sim./plan | CPU, s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for squeeze, stiffness in CASES:
        plan, spent = planned(rig, squeeze, stiffness)
        expected, seen = plan.expected.rpy_std.mean(), driven(rig, plan, stiffness)
        print(
            f"| {squeeze:g} | {1e-6 * stiffness:g} | {1e3 * expected:.3f} "
            f"| {1e3 * plan.random.rpy_std.mean():.3f} | {plan.improvement:.2f} "
            f"| {1e3 * seen:.3f} | {seen / expected:.3f} | {spent:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
