"""Mountings that nobody stated, and wirings that are wrong.

    python -m benchmarks.mountings [RUNS] [WIRINGS] > benchmarks/mountings.md

Nominal mountings are zeros in the rig file; the sensors stand upside down, sideways, all turned by
0.7 rad, or anyhow. Right: every angle within 5 σ. Wirings: sensors exchanged, two axes exchanged,
one of opposite sign, the reaction recorded, a wrong unit; named where the refusal (exit 3) says so.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace

import numpy as np

from tdfscal import simulation
from tdfscal.errors import DataError, NotIdentifiableError, TdfscalError
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options

OPTIONS = Options(squeeze=100.0)
MOUNTINGS = ("one upside down", "all upside down", "one sideways", "all by 0.7 rad", "anyhow")
WIRINGS: dict[str, tuple[FloatArray | None, str]] = {
    "two sensors exchanged": (None, "ncp1 taken from ncp2"),
    "Fx and Fy of one exchanged": (np.eye(3)[[1, 0, 2]], "Fx and Fy of ncp1"),
    "Fz of one of opposite sign": (np.diag([1.0, 1.0, -1.0]), "opposite sign of Fz of ncp1"),
    "the reaction, all": (-np.eye(3), "wrong sign"),
    "kN read as N, all": (1e-3 * np.eye(3), "kN"),
    "kgf read as N, all": (np.eye(3) / 9.80665, "kgf"),
}


def mounted(kind: str, rng: np.random.Generator) -> FloatArray:
    """Roll, pitch, yaw (3, 3) of the real mounting."""
    rpy = rng.normal(scale=0.02, size=(3, 3))
    match kind:
        case "one upside down":
            rpy[0, 0] += np.pi
        case "all upside down":
            rpy[:, 0] += np.pi
        case "one sideways":
            rpy[0, 0] += np.pi / 2
        case "all by 0.7 rad":
            rpy += so3.to_rpy(so3.exp(0.7 * np.array([0.6, 0.64, 0.48])))
        case _:
            rpy = so3.to_rpy(so3.project(rng.standard_normal((3, 3, 3))))
    return rpy


def wired(dwells: Dwells, matrix: FloatArray | None, words: str) -> Dwells:
    """Dwells as a wrong cabling records them."""
    force = dwells.force.copy()
    if matrix is None:
        return replace(dwells, force=force[:, [1, 0, 2]])
    which = slice(None) if "ncp1" not in words else slice(0, 1)
    force[:, which] = force[:, which] @ matrix.T
    return replace(dwells, force=force)


def outcome(rig: Rig, dwells: Dwells, truth: FloatArray) -> str:
    """Right, ambiguous, refused or wrong."""
    try:
        result = self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
    except NotIdentifiableError:
        return "exit 4"
    except TdfscalError:
        return "refused"
    off = so3.log(truth @ np.swapaxes(result.fit.state.rotation, 1, 2)).ravel()
    std = np.sqrt(np.diagonal(result.uncertainty.covariance))
    return "right" if (np.abs(off) < 5 * std).all() else "wrong"


def refusal(rig: Rig, dwells: Dwells, words: str) -> str:
    """Named, refused otherwise, or accepted."""
    try:
        self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
    except DataError as error:
        return "named" if words in str(error) else "otherwise"
    except TdfscalError:
        return "otherwise"
    return "accepted"


def main() -> None:
    """Print both tables."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    wirings = int(sys.argv[2]) if len(sys.argv) > 2 else 40
    rig = simulation.reference_rig()
    print("# Unstated mountings and wrong wirings\n")
    print(f"`python -m benchmarks.mountings {runs} {wirings}`; squeeze 100 N, 24 postures.\n")
    print("| mounting | campaigns | right | exit 4 | refused | wrong |\n|---|---|---|---|---|---|")
    for seed, kind in enumerate(MOUNTINGS):
        rng, found = np.random.default_rng(seed), Counter[str]()
        for _ in range(runs // len(MOUNTINGS)):
            options = replace(OPTIONS, rpy=mounted(kind, rng))
            batch = simulation.simulate_dwells(rig, options, rng, 1)
            found[outcome(rig, batch.dwells(0), batch.truth.rotation[0])] += 1
        cells = " | ".join(str(found[name]) for name in ("right", "exit 4", "refused", "wrong"))
        print(f"| {kind} | {found.total()} | {cells} |", flush=True)
    print("\n| wiring | campaigns | named | refused otherwise | accepted |\n|---|---|---|---|---|")
    for seed, (kind, (matrix, words)) in enumerate(WIRINGS.items()):
        batch = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(seed), wirings)
        found = Counter(
            refusal(rig, wired(batch.dwells(i), matrix, words), words) for i in range(wirings)
        )
        cells = " | ".join(str(found[name]) for name in ("named", "otherwise", "accepted"))
        print(f"| {kind} | {wirings} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
