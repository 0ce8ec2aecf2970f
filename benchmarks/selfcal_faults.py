"""One fault at a time: does the calibration notice what nobody declared?

    python -m benchmarks.selfcal_faults [TRIALS] > benchmarks/selfcal_faults.md

The same campaigns, to the last random number, are calibrated with the fault and without it. A run
counts as harmed when the fault moves an angle by more than twice its stated uncertainty; as noticed
when the gate rejects it, a warning is given, postures are rejected by name, or it is refused. With
the fault declared in the rig file, where it can be, the errors must be covered again.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from tdfscal import simulation
from tdfscal.errors import TdfscalError
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import (
    Contact,
    Crosstalk,
    DeadAxis,
    Drift,
    Faults,
    Gain,
    Options,
    ZeroShift,
)

BASE = Options(squeeze=100.0)
RIG = simulation.reference_rig()
NONE = Faults()


@dataclass(frozen=True)
class Case:
    """A fault: the rig as it is, as it is stated, what happens, and how it could be declared."""

    name: str
    real: Rig = RIG
    stated: Rig = RIG
    faults: Faults = NONE
    declared: Rig | None = None
    often: int = 1  # times as many campaigns: a false alarm and a narrow harm are rare


def declared(**changes: float) -> Rig:
    return replace(RIG, declared=replace(RIG.declared, **changes))


def wide_zero(std: float) -> Rig:
    return replace(RIG, zero=UncertainValue(RIG.zero.value, np.full((3, 3), std)))


def cases() -> list[Case]:
    """Return every fault of the list, at sizes that matter and at sizes that hardly do."""
    found = [Case("none", often=25)]
    for size in (1.0, 3.0):
        shift = ZeroShift(0, 12, (size, -size, size))
        found.append(
            Case(f"zero shifts by {size:g} N at half time", faults=Faults(zero_shifts=(shift,)))
        )
    for size in (1e-3, 3e-3, 1e-2):
        gain, cross = Gain(0, (size,) * 3), Crosstalk(0, (size,) * 3)
        wide = declared(force_sensitivity=size)
        found.append(
            Case(
                f"gain of one sensor {100 * size:g} % off",
                faults=Faults(gains=(gain,)),
                declared=wide,
            )
        )
        found.append(
            Case(
                f"crosstalk of one sensor {100 * size:g} %",
                faults=Faults(crosstalk=(cross,)),
                declared=wide,
            )
        )
    mass = RIG.mass.value
    found.append(
        Case(
            "mass 1 % off",
            real=replace(RIG, mass=UncertainValue(1.01 * mass, RIG.mass.std)),
            declared=replace(RIG, mass=UncertainValue(mass, 0.01 * mass)),
        )
    )
    off = RIG.barycentre.value + np.array([3e-3, -3e-3, 2.65e-3])
    found.append(
        Case(
            "barycentre 5 mm off",
            real=replace(RIG, barycentre=UncertainValue(off, RIG.barycentre.std)),
            declared=replace(
                RIG, barycentre=UncertainValue(RIG.barycentre.value, np.full(3, 5e-3))
            ),
        )
    )
    for tilt in (5e-4, 2e-3):
        tilted = replace(RIG, gravity_tilt_std=tilt)
        name, often = f"BCS tilted, {1e3 * tilt:g} mrad (std)", 25 if tilt < 1e-3 else 1
        found.append(Case(name, real=tilted, declared=tilted, often=often))
    for friction in (0.1, 0.2, 0.5):
        rough, often = declared(hinge_moment=friction), 10 if friction < 0.2 else 1
        name = f"hinge friction {friction:g} N·m"
        found.append(Case(name, real=rough, declared=rough, often=often))
    for size in (1.0, 5.0):
        creep = Drift(0, (size, size, size))
        found.append(Case(f"zero drifts by {size:g} N", faults=Faults(drifts=(creep,))))
    for count in (1, 2, 3):
        touch = tuple(Contact(5 + 6 * k, (5.0, -8.0, 10.0), (2.0, 1.0, -1.0)) for k in range(count))
        found.append(Case(f"contact of 14 N in {count} postures", faults=Faults(contacts=touch)))
    share = float(mass) * RIG.gravity / 3
    capped = replace(RIG, capacity=np.full((3, 3), 1.05 * share))
    found.append(Case("saturation", real=capped, stated=capped, faults=Faults(saturated=True)))
    found.append(Case("dead axis from the start", faults=Faults(dead_axes=(DeadAxis(0, 0, 0),))))
    found.append(Case("dead axis from posture 8 on", faults=Faults(dead_axes=(DeadAxis(0, 0, 8),))))
    return found


def calibrate(rig: Rig, dwells: Dwells) -> SelfCalibration | None:
    """Return the result, or None where it is refused."""
    try:
        return self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
    except TdfscalError:
        return None


def turn(truth: FloatArray, result: SelfCalibration) -> FloatArray:
    return so3.log(truth @ np.swapaxes(result.fit.state.rotation, 1, 2)).ravel()


def noticed(result: SelfCalibration | None) -> bool:
    return result is None or bool(result.findings or result.rejected)


def row(case: Case, trials: int, seed: int) -> str:
    """Run one case and format its row."""
    options = replace(BASE, faults=case.faults)
    rng = np.random.default_rng(seed)
    batch = simulation.simulate_dwells(case.real, options, rng, trials)
    sane = replace(case.stated, capacity=np.full((3, 3), np.inf))
    plain = simulation.simulate_dwells(sane, BASE, np.random.default_rng(seed), trials)
    found = harmed = caught = 0
    distance, covered = [], []
    for i in range(trials):
        result, clean = calibrate(case.stated, batch.dwells(i)), calibrate(sane, plain.dwells(i))
        seen = noticed(result)
        found += seen
        if result is None:
            harmed, caught = harmed + 1, caught + 1
        elif clean is not None and case.name != "none":
            std = np.sqrt(np.diagonal(clean.uncertainty.covariance))
            moved = np.abs(
                turn(batch.truth.rotation[i], result) - turn(plain.truth.rotation[i], clean)
            )
            harm = bool((moved > 2 * std).any())
            harmed, caught = harmed + harm, caught + (harm and seen)
        if case.declared is not None:
            again = calibrate(case.declared, batch.dwells(i))
            if again is not None:
                d, C = turn(batch.truth.rotation[i], again), again.uncertainty.covariance
                distance.append(d @ np.linalg.solve(C, d) / len(d))
                covered.append(np.mean(np.abs(d) < 1.96 * np.sqrt(np.diagonal(C))))
    rate = f"{caught / harmed:.1%} of {harmed}" if harmed else "–"
    cover = f"{np.mean(distance):.2f} | {np.mean(covered):.3f}" if distance else "– | –"
    shares = f"{found / trials:.1%} | {harmed / trials:.1%}"
    return f"| {case.name} | {trials} | {shares} | {rate} | {cover} |"


def main() -> None:
    """Print the table."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print(
        "# Faults that nobody declared\n\n"
        f"`python -m benchmarks.selfcal_faults {trials}`; reference "
        "rig, 24 postures, squeeze 100 N.\nWhat is noticed without a fault is a false alarm.\n\n"
        "| fault | campaigns | noticed | harmed | noticed where harmed | declared: d²/3n "
        "| in 95 % |\n|---|---|---|---|---|---|---|"
    )
    for seed, case in enumerate(cases()):
        print(row(case, trials * case.often, seed), flush=True)


if __name__ == "__main__":
    main()
