"""How often a faultless log in motion is questioned: score tests on clean logs of several kinds.

    python -m benchmarks.motion_alarms CASE [--runs 60] [--first 8000]

CASE: slow, white, approach (see `benchmarks.motion`), stops (ten rests and moves, 0.3 N of slow
noise). Suspected: any suspicion; harmful: one that the gate rejects for. The level is
`significance.UNDECLARED_ERROR` per log, whatever the number of suspects.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.motion import CASES, DELAY
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.simulation import reference_rig
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.moving_options import MovingOptions

KINDS = {
    "slow": CASES["slow"],
    "white": CASES["white"],
    "approach": CASES["approach"],
    "stops": replace(MovingOptions.stops(), slow_noise=0.3),
}


def main() -> None:
    """Run one case and print its row, and what was suspected."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=sorted(KINDS))
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--first", type=int, default=8000)
    chosen = parser.parse_args()
    suspected, harmful = [], 0
    for seed in range(chosen.first, chosen.first + chosen.runs):
        rig = reference_rig()
        campaign = simulate_moving(rig, KINDS[chosen.case], np.random.default_rng(seed))
        slow = slow_streams([campaign.log], rig.capacity)
        found = calibrate_moving(rig, slow, DELAY).suspicions
        if found:
            suspected.append(f"{seed}: {found[0].kind}, p = {found[0].p_value:.2g}")
            harmful += any(doubt.harmful for doubt in found)
    print(
        f"| {chosen.case} | {chosen.runs} | {len(suspected)} | {harmful} | {'; '.join(suspected)}"
    )


if __name__ == "__main__":
    main()
