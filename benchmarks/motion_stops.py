"""Rests and moves in one estimate against the truth, beside the rests alone.

    python -m benchmarks.motion_stops CASE [--runs 24] [--first 1000] [--seconds 144]

CASE: white, slow (0.3 N of noise slow as 2 s besides), stiff (carriages of 200 N/µm, white noise,
where the positioners' errors weigh most). 15 postures in 144 s, rests of 6 s and moves of 4 s; what
else a run draws is as in `benchmarks.motion`. Wider: runs in which an angle's uncertainty is above
that of the rests alone.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

import numpy as np

from benchmarks.motion import DELAY
from tdfscal.dwells import find_dwells
from tdfscal.errors import TdfscalError
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import reference_rig
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.moving_options import MovingOptions

BASE = replace(MovingOptions.stops(), duration=144.0)
CASES = {
    "white": BASE,
    "slow": replace(BASE, slow_noise=0.3),
    "stiff": replace(BASE, stiffness=(200e6, 200e6, 200e6)),
}


def score(true: FloatArray, found: FloatArray, cov: FloatArray) -> FloatArray:
    """Error (9,), stated standard uncertainty (9,) and d²/9 of rotations (n, 3, 3)."""
    e = so3.log(true @ np.swapaxes(found, 1, 2)).ravel()
    return np.array([*e, *np.sqrt(np.diagonal(cov)), e @ np.linalg.solve(cov, e) / len(e)])


def row(name: str, part: FloatArray) -> str:
    """One row of the table."""
    half = (part.shape[1] - 1) // 2
    e, s, d = part[:, :half], part[:, half : 2 * half], part[:, -1]
    return (
        f"| {name} | {len(part)} | {1e3 * np.sqrt(np.mean(e**2)):.3f} | "
        f"{1e3 * np.sqrt(np.mean(s**2)):.3f} | {d.mean():.2f} ± "
        f"{np.std(d) / np.sqrt(len(d)):.2f} | {np.mean(np.abs(e) < 1.96 * s):.1%} |"
    )


def main() -> None:
    """Run one case and print its rows."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=sorted(CASES))
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=144.0)
    chosen = parser.parse_args()
    rests, whole, wider, refused = [], [], 0, 0
    for seed in range(chosen.first, chosen.first + chosen.runs):
        rig = reference_rig()
        options = replace(CASES[chosen.case], duration=chosen.seconds)
        campaign = simulate_moving(rig, options, np.random.default_rng(seed))
        dwells = find_dwells([campaign.log])
        try:
            alone = self_calibrate(rig, dwells, rng=np.random.default_rng(seed), max_trials=0)
            slow = slow_streams([campaign.log], rig.capacity)
            both = calibrate_moving(rig, slow, DELAY, dwells=len(dwells))
        except TdfscalError as error:
            print(f"{seed}: {error}", file=sys.stderr)
            refused += 1
            continue
        true = campaign.truth.rotation
        rests.append(score(true, alone.fit.state.rotation, alone.uncertainty.covariance))
        turns = both.uncertainty.turns
        whole.append(score(true, both.fit.state.still.rotation, turns.covariance))
        wider += bool(np.any(turns.rpy_std > alone.uncertainty.rpy_std))
    print(row(f"{chosen.case}, rests", np.array(rests)))
    print(f"{row(f'{chosen.case}, all', np.array(whole))} wider {wider}, refused {refused}")


if __name__ == "__main__":
    main()
