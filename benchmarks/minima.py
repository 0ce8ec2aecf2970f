"""Is the right minimum found, or is it said that two cannot be told apart?

    python -m benchmarks.minima [RUNS] > benchmarks/minima.md

Nominal mountings that are wrong (every sensor's yaw off by half a turn; random yaws), internal
forces of N newtons, K postures, friction of the hinges declared, noise of 1 N.
Right: accepted or rejected, and every angle within 5 σ. Ambiguous: exit 4 with two mountings
named; unseen: exit 4 since a turn is not determined. Wrong: an angle more than 5 σ off is stated.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np

from tdfscal import simulation
from tdfscal.errors import NotIdentifiableError, TdfscalError
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, Recorder

FORCES, POSTURES, NOISE, FRICTION = (10.0, 20.0, 50.0, 200.0), (12, 40, 200), 1.0, 0.05
#: Nominal mounting, and the largest tilt, °: with less tilt half a turn of all shows less.
CASES = (("all turned by 180°", 5.0), ("all turned by 180°", 1.0), ("random yaws", 5.0))


def real_rig() -> Rig:
    """A rig whose sensors stand where nobody said, within 0.02 rad."""
    rig = simulation.reference_rig()
    declared = replace(rig.declared, hinge_moment=FRICTION)
    return replace(rig, declared=declared, rpy_std=np.full((3, 3), 0.02))


def stated(rig: Rig, kind: str, rng: np.random.Generator) -> Rig:
    """The same rig with nominal yaws that are off, and no prior on them."""
    off = rng.uniform(-np.pi, np.pi, 3) if kind == "random yaws" else np.full(3, np.pi)
    nominal = rig.nominal_rpy + off[:, None] * np.array([0.0, 0.0, 1.0])
    return replace(rig, nominal_rpy=nominal, rpy_std=np.full((3, 3), np.inf))


def outcome(rig: Rig, dwells: simulation.Batch, trial: int, truth: FloatArray) -> str:
    """Right, ambiguous, unseen, refused or wrong."""
    try:
        result = self_calibrate(
            rig, dwells.dwells(trial), rng=np.random.default_rng(0), max_trials=0
        )
    except NotIdentifiableError as error:
        return "ambiguous" if "two mountings" in str(error) else "unseen"
    except TdfscalError:
        return "refused"
    off = so3.log(truth @ np.swapaxes(result.fit.state.rotation, 1, 2)).ravel()
    std = np.sqrt(np.diagonal(result.uncertainty.covariance))
    return "right" if (np.abs(off) < 5 * std).all() else "wrong"


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    print(f"# The right minimum\n\n`python -m benchmarks.minima {runs}`: {runs} campaigns a row.\n")
    print("| nominal | tilt, ° | N | K | right | ambiguous | unseen | refused | wrong |")
    print("|---|---|---|---|---|---|---|---|---|")
    total: Counter[str] = Counter()
    for seed, ((kind, tilt), force, count) in enumerate(product(CASES, FORCES, POSTURES)):
        rng, real = np.random.default_rng(seed), real_rig()
        options = Options(
            postures=count,
            tilt=np.radians(tilt),
            internal=force,
            recorder=Recorder(mean_sd=NOISE),
        )
        batch = simulation.simulate_dwells(real, options, rng, runs)
        found = Counter(
            outcome(stated(real, kind, rng), batch, i, batch.truth.rotation[i]) for i in range(runs)
        )
        total += found
        cells = " | ".join(
            str(found[name]) for name in ("right", "ambiguous", "unseen", "refused", "wrong")
        )
        print(f"| {kind} | {tilt:g} | {force:g} | {count} | {cells} |", flush=True)
    print(f"\nAll: {dict(total)}.")


if __name__ == "__main__":
    main()
