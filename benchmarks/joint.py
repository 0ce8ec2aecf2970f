"""Joint calibration: stated covariance against the truth, and against either method alone.

    python -m benchmarks.joint [TRIALS] > benchmarks/joint.md

Every trial draws a machine, simulates its campaign and its laser-tracker survey, calibrates by both
methods and combines them.
"""

from __future__ import annotations

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from tdfscal import simulation
from tdfscal.comparison.joint import combine
from tdfscal.numerics import so3
from tdfscal.records import Rotations
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, SurveyOptions, simulate_survey
from tdfscal.trackercal import calibrate_tracker


def main() -> None:
    """Print the table."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rig = simulation.reference_rig()
    batch = simulation.simulate_dwells(rig, Options(squeeze=50.0), np.random.default_rng(0), trials)
    rng = np.random.default_rng(1)
    methods = ("self", "tracker", "joint")
    distance: dict[str, list[float]] = {m: [] for m in methods}
    error: dict[str, list[float]] = {m: [] for m in methods}
    worse, inconsistent, largest = 0, 0, []
    for i in range(trials):
        truth = batch.truth.trial(i)
        own = self_calibrate(rig, batch.dwells(i), rng=rng, max_trials=0)
        mine = Rotations(rig.supports, own.fit.state.rotation, own.uncertainty.covariance)
        session = simulate_survey(rig, truth, SurveyOptions(), rng).session
        theirs = calibrate_tracker(rig, session, trials=0).rotations
        both = combine(mine, theirs)
        inconsistent += not both.test.verified
        largest.append(float(np.abs(both.test.en).max()))
        for name, found in zip(methods, (mine, theirs, both.rotations), strict=True):
            d = so3.log(truth.rotation @ np.swapaxes(found.rotation, 1, 2)).ravel()
            distance[name].append(float(d @ np.linalg.solve(found.covariance, d)) / len(d))
            error[name].append(float(np.mean(d**2)))
        better = np.minimum(*(np.linalg.eigvalsh(c.covariance).max() for c in (mine, theirs)))
        for single in (mine, theirs):  # in no direction wider than either
            gap = single.covariance - both.rotations.covariance
            worse += bool(np.linalg.eigvalsh(gap).min() < -1e-9 * better)
    print("# Both methods together\n")
    print(f"`python -m benchmarks.joint {trials}`: {trials} machines, reference rig, 24 postures,")
    print("squeeze 50 N; the paper's tracker 5 m away, four targets on a 0.1 m square, 12 moves.\n")
    print("| method | RMS error, mrad | d²/3n | its standard error |\n|---|---|---|---|")
    for name in methods:
        d2 = np.array(distance[name])
        rms = 1e3 * np.sqrt(np.mean(error[name]))
        print(f"| {name} | {rms:.3f} | {d2.mean():.3f} | {d2.std(ddof=1) / np.sqrt(trials):.3f} |")
    print(f"\nJoint variance above that of a single method in any direction: {worse} times.")
    print(f"Consistency test failed (p < 0.01): {inconsistent} of {trials}.")


if __name__ == "__main__":
    main()
