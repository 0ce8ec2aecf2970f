"""Zeros that are wrong because something else is: does the gate let them through?

    python -m benchmarks.zeros [RUNS] [FAULTLESS] > benchmarks/zeros.md

Zeros are estimated, so that an error of a mass or barycentre called exact goes into them, and
hardly into an angle. A controller loads both. The errors are true ones, by the simulator.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.selfcal_faults import calibrate, turn
from tdfscal import simulation
from tdfscal.model.parameters import layout
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.selfcal.suspicion import Suspicion
from tdfscal.simulation import Options

RIG = simulation.reference_rig()
SQUEEZES = (0.0, 100.0, 300.0)


def exact(value: FloatArray) -> UncertainValue:
    return UncertainValue(np.asarray(value), np.zeros_like(value))


#: Mass and barycentre as they are called; zeros unknown, and as a tare knows them.
EXACT = replace(RIG, mass=exact(RIG.mass.value), barycentre=exact(RIG.barycentre.value))
UNKNOWN = replace(EXACT, zero=UncertainValue(RIG.zero.value, np.full((3, 3), np.inf)))
REAL = replace(EXACT, zero=UncertainValue(RIG.zero.value, np.full((3, 3), 20.0)))


@dataclass(frozen=True)
class Case:
    """A rig as it is and as it is stated."""

    name: str
    real: Rig
    stated: Rig


def cases() -> Iterator[Case]:
    """Errors that hardly matter, and such that do."""
    yield Case("none, zeros unknown, mass and barycentre exact", REAL, UNKNOWN)
    yield Case("none, all as the reference rig states it", RIG, RIG)
    for size in (1e-4, 2e-4, 5e-4, 1e-3, 2e-3):
        for axis, name in ((0, "sideways"), (2, "upwards")):
            off = RIG.barycentre.value + size * np.eye(3)[axis]
            stated = replace(UNKNOWN, barycentre=exact(off))
            yield Case(f"exact barycentre {1e3 * size:g} mm {name}", REAL, stated)
    for size in (0.05, 0.5, 2.0):
        heavier = RIG.mass.value + size
        stated = replace(UNKNOWN, mass=exact(heavier))
        yield Case(f"exact mass {size:g} kg off, zeros unknown", REAL, stated)
        stated = replace(RIG, mass=exact(heavier))
        real = replace(RIG, mass=exact(RIG.mass.value))
        yield Case(f"exact mass {size:g} kg off, zeros ± 0.5 N", real, stated)


def zero_error(truth: FloatArray, result: SelfCalibration) -> FloatArray:
    """Errors of the zeros in their standard uncertainties, (3n,)."""
    std = result.uncertainty.parameter_std[layout(result.rig.n)["zero"]]
    return (result.fit.state.zero - truth).ravel() / std


def by_angles(doubt: Suspicion) -> bool:
    """Whether it spoils the result by its angles alone."""
    return replace(doubt, zero_shift=0.0).harmful


def row(case: Case, runs: int, seed: int) -> str:
    """Run one case and format its row."""
    seen, worst, angles = Counter[str](), list[float](), list[float]()
    for i, squeeze in enumerate(SQUEEZES):
        rng = np.random.default_rng([seed, i])
        batch = simulation.simulate_dwells(case.real, Options(squeeze=squeeze), rng, runs)
        for k in range(runs):
            result = calibrate(case.stated, batch.dwells(k))
            if result is None:
                seen["refused"] += 1
                continue
            worst.append(float(np.abs(zero_error(batch.truth.zero[k], result)).max()))
            std = np.sqrt(np.diagonal(result.uncertainty.covariance))
            angles.append(float(np.abs(turn(batch.truth.rotation[k], result) / std).max()))
            doubts = result.suspicions
            seen["named"] += bool(doubts)
            seen["angles"] += any(by_angles(doubt) for doubt in doubts)
            seen["spoiled"] += any(doubt.harmful for doubt in doubts)
            seen["rejected"] += bool(result.reasons)
            told = any("the zeros rest on it" in text for text in result.warnings)
            seen["told"] += told
            seen["silent"] += not (result.reasons or told or doubts) and worst[-1] > 5
    total = runs * len(SQUEEZES)
    sizes = [f"{np.median(each):.1f}" if each else "–" for each in (worst, angles)]
    counts = [
        seen[key] for key in ("refused", "named", "angles", "spoiled", "rejected", "told", "silent")
    ]
    cells = [case.name, total, *sizes, *counts]
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    faultless = int(sys.argv[2]) if len(sys.argv) > 2 else 10 * runs
    print(
        "# Zeros that something else makes wrong\n\n"
        f"`python -m benchmarks.zeros {runs} {faultless}`; reference rig, 24 postures, squeeze 0, "
        "100 and 300 N.\nSizes: the largest error of a zero, and of an angle, in stated standard "
        "uncertainties, median.\nSpoiled: a suspicion rejects, by its effect on angles alone, and "
        "on angles or zeros. Told: a warning\nsays that the zeros rest on what is called "
        "exact. Silent: none of these, though a zero is wrong by more\nthan five.\n"
    )
    heads = ["stated wrong", "campaigns", "zero", "angle", "refused", "named", "spoiled by angles"]
    heads += ["spoiled", "rejected", "told", "silent"]
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for seed, case in enumerate(cases()):
        print(row(case, faultless if seed < 2 else runs, seed), flush=True)


if __name__ == "__main__":
    main()
