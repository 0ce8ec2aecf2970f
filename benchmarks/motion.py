"""Calibration in motion against the truth: error, honesty of what is stated, contacts, the bound.

    python -m benchmarks.motion CASE [--lacking AXES] [--runs 100] [--first 1000]

CASE: white, slow, approach (clean logs), contact, approach-contact, dwells. Each run draws a rig,
a motion, error fields and noise of its own; the estimator knows what a rig file states. RMSE over
all angles of all runs; d²/3n with the full stated covariance; share of errors within ±1.96 stated
standard uncertainties, and of roll, pitch, yaw within the trials' 95 % intervals; the bound is the
Cramér–Rao bound of the linearised model with the true spectrum of the force noise, positions
without error and all nuisances free. With axes lacking, all of it is over the sensors whose angles
are determined.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from tdfscal.model.dynamics import Moving, voigt
from tdfscal.model.parameters import nominal
from tdfscal.motioncal.blocks import blocks
from tdfscal.motioncal.estimator import MovingPriors, MovingState, at_state
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import Slow, slow_streams
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.simulation import reference_rig
from tdfscal.simulation.moving_campaign import MovingCampaign, simulate_moving
from tdfscal.simulation.moving_options import MovingOptions, Touch
from tdfscal.simulation.reference_rig import make_rig

DELAY = UncertainValue(np.array(0.0), np.array(0.02))
TOUCH = (9.0, -6.0, 10.39)  # 15 N
CASES = {
    "white": MovingOptions(),
    "slow": MovingOptions(slow_noise=0.3),
    "approach": MovingOptions.approach(),
    "contact": MovingOptions(slow_noise=0.3, touches=(Touch(28.5, 31.5, TOUCH),)),
    "approach-contact": replace(MovingOptions.approach(), touches=(Touch(15.0, 18.0, TOUCH),)),
}
#: Supports, and the axes (support, axis) that are not measured.
LACKING: dict[str, tuple[int, tuple[tuple[int, int], ...]]] = {
    "lateral": (3, ((2, 1),)),
    "vertical": (3, ((2, 2),)),
    "both laterals": (3, ((2, 0), (2, 1))),
    "sensor of four": (4, ((3, 0), (3, 1), (3, 2))),
    "two load cells of four": (4, ((2, 0), (2, 1), (3, 0), (3, 1))),
}


def bound(rig: Rig, campaign: MovingCampaign, slow: Slow) -> FloatArray:
    """Cramér–Rao covariance (3n, 3n), rad², at the truth; rig : as stated."""
    truth, options = campaign.truth, campaign.options
    still = replace(
        nominal(rig), rotation=truth.rotation, zero=truth.zero, mass=truth.mass,
        barycentre=truth.barycentre, hinge=truth.hinge, datum=-truth.datum,
    )  # fmt: skip
    state = MovingState(still, Moving(voigt(campaign.inertia), options.friction, options.delay))
    cut = blocks(slow, np.ones(len(slow.time), dtype=np.bool_))
    fit = at_state(MovingPriors(rig, slow, DELAY), cut, state, None)
    f = fit.rows.bins.frequency
    density = options.noise**2 / options.rate + options.slow_noise**2 * 2 * options.slow_time / (
        1 + (2 * np.pi * f * options.slow_time) ** 2
    )
    # All of the log counts, also what lies under the taper's ramps.
    J = fit.rows.weighted(fit.jacobian, cut[0].share * density)
    root = spectrum(np.concatenate([J, fit.prior_jacobian])).root
    return (root @ root.T)[: 3 * rig.n, : 3 * rig.n]


def played(
    case: str, lacking: str | None, seed: int
) -> tuple[Rig, MovingCampaign, Slow, MotionCalibration, float]:
    """One run: rig as stated, campaign, streams, result and the seconds that the result took."""
    n, missing = LACKING[lacking] if lacking else (3, ())
    real = make_rig(n) if lacking else reference_rig()
    campaign = simulate_moving(real, CASES[case], np.random.default_rng(seed))
    axes = real.axes.copy()
    for support, axis in missing:
        axes[support, axis] = False
    rig = replace(real, axes=axes)
    slow = slow_streams([campaign.log], rig.capacity)
    slow = replace(slow, force=np.where(axes, slow.force, 0.0))
    began = time.perf_counter()
    result = calibrate_moving(rig, slow, DELAY, rng=np.random.default_rng(seed))
    return rig, campaign, slow, result, time.perf_counter() - began


def main() -> None:
    """Run one case and print its row."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=sorted(CASES))
    parser.add_argument("--lacking", choices=sorted(LACKING))
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--first", type=int, default=1000)
    chosen = parser.parse_args()
    error, std, distance, least, named, seconds = [], [], [], [], 0, []
    inside, refuted = [], 0
    for seed in range(chosen.first, chosen.first + chosen.runs):
        rig, campaign, slow, result, took = played(chosen.case, chosen.lacking, seed)
        known = np.flatnonzero(np.repeat(result.observability.determined, 3))
        e = so3.log(
            campaign.truth.rotation @ np.swapaxes(result.fit.state.still.rotation, 1, 2)
        ).ravel()[known]
        C = result.uncertainty.turns.covariance[np.ix_(known, known)]
        error.append(e)
        std.append(np.sqrt(np.diagonal(C)))
        distance.append(float(e @ np.linalg.solve(C, e)) / len(e))
        least.append(np.diagonal(bound(rig, campaign, slow))[known])
        named += bool(result.rejected)
        trials = result.monte_carlo
        assert trials is not None
        rpy = so3.to_rpy(campaign.truth.rotation)
        inside.append(np.mean(((trials.low < rpy) & (rpy < trials.high)).ravel()[known]))
        refuted += not trials.validated
        seconds.append(took)
    e, s = np.concatenate(error), np.concatenate(std)
    rmse, least_rms = np.sqrt(np.mean(e**2)), np.sqrt(np.mean(np.concatenate(least)))
    spread = np.std(distance) / np.sqrt(len(distance))
    name = f"{chosen.case}, without {chosen.lacking}" if chosen.lacking else chosen.case
    print(
        f"| {name} | {chosen.runs} | {1e3 * rmse:.3f} | "
        f"{1e3 * np.sqrt(np.mean(s**2)):.3f} | {1e3 * least_rms:.3f} | {rmse / least_rms:.2f} | "
        f"{np.mean(distance):.2f} ± {spread:.2f} | {np.mean(np.abs(e) < 1.96 * s):.1%} | "
        f"{np.mean(inside):.1%} ± {np.std(inside) / np.sqrt(len(inside)):.1%} | {refuted} | "
        f"{named} | {np.median(seconds):.1f} |"
    )


if __name__ == "__main__":
    main()
