"""`validate` on logs in motion: false alarms at its level, and faults that it must name.

    python -m benchmarks.motion_validation CASE [--runs 60] [--first 0] [--approach] [--slow 0.3]

CASE: clean, turn (one sensor by 2 mrad in a random direction), zero (one sensor's zero by 1 N),
zero3 (by 3 N), load (2 kg and 2 mm), contact (15 N for 3 s; must hold). Each run calibrates a
minute of motion and validates another motion of the same machine, a minute or (--approach) an
ordinary approach of 33 s.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.records import UncertainValue
from tdfscal.simulation import reference_rig
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.moving_options import MovingOptions, Touch
from tdfscal.simulation.truth import Truth
from tdfscal.validation.in_motion import MovingValidation, validate_moving

DELAY = UncertainValue(np.array(0.0), np.array(0.02))
TOUCH = (Touch(15.0, 18.0, (9.0, -6.0, 10.39)),)
KINDS = {"turn": "sensor turned", "zero": "zero drifted", "zero3": "zero drifted"}
KINDS["load"] = "load changed"


def changed(case: str, truth: Truth, sensor: int, rng: np.random.Generator) -> Truth:
    """The machine after what the case does to it."""
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    if case == "turn":
        rotation = truth.rotation.copy()
        rotation[sensor] = so3.exp(2e-3 * way) @ rotation[sensor]
        return replace(truth, rotation=rotation)
    if case in ("zero", "zero3"):
        zero = truth.zero.copy()
        zero[sensor] += way * (3.0 if case == "zero3" else 1.0)
        return replace(truth, zero=zero)
    if case == "load":
        shift = np.array([2e-3, 0.0, 0.0])
        return replace(truth, mass=truth.mass + 2.0, barycentre=truth.barycentre + shift)
    return truth


def played(case: str, seed: int, *, approach: bool, slow: float) -> tuple[MovingValidation, int]:
    """One run: the verdict, and the sensor that was touched."""
    rig, rng = reference_rig(), np.random.default_rng(seed)
    first, second = rng.spawn(2)
    base = MovingOptions(rate=100.0, noise=1.1, slow_noise=slow)
    before = simulate_moving(rig, base, first)
    known = calibrate_moving(rig, slow_streams([before.log], rig.capacity), DELAY)
    sensor = int(rng.integers(rig.n))
    drive = MovingOptions.approach() if approach else base
    options = replace(
        drive, rate=100.0, noise=1.1, slow_noise=slow, inertia=before.inertia,
        touches=TOUCH if case == "contact" else (),
    )  # fmt: skip
    after = simulate_moving(rig, options, second, changed(case, before.truth, sensor, rng))
    streams = slow_streams([after.log], rig.capacity)
    return validate_moving(known.calibrated, streams, DELAY), sensor


def main() -> None:
    """Print one row of the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=["clean", "turn", "zero", "zero3", "load", "contact"])
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--approach", action="store_true")
    parser.add_argument("--slow", type=float, default=0.3)
    chosen = parser.parse_args()
    held = first = alone = among = left_out = below = 0
    turns = []
    for seed in range(chosen.first, chosen.first + chosen.runs):
        v, sensor = played(chosen.case, seed, approach=chosen.approach, slow=chosen.slow)
        held += v.holds
        left_out += bool(v.rejected)
        below += v.p_value < 0.05
        turns.append(v.detectable)
        wanted = (KINDS.get(chosen.case), None if chosen.case == "load" else sensor)
        named = [(cause.kind, cause.support) for cause in v.suspected]
        first += named[:1] == [wanted]
        alone += named == [wanted]
        among += wanted in named
    size = 1e3 * np.median(turns, axis=0)
    what = "approach" if chosen.approach else "minute"
    print(
        f"| {what}, {chosen.case} | {chosen.runs} | {held} | {below / chosen.runs:.1%} | "
        f"{among} | {first} | {alone} | {left_out} | "
        f"{size[:, :2].mean():.2f} / {size[:, 2].mean():.2f} |"
    )


if __name__ == "__main__":
    main()
