"""What sets the maxima of docking and the deviations in free space: causes taken away one by one.

Run: python -m benchmarks.docking > benchmarks/docking.md
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal.records import FloatArray, Instrument
from tdfscal.simulation import Options, reference_rig
from tdfscal.simulation.control.contact import GearPair
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import SQUEEZE, Arms, drifted, simulated
from tdfscal.wrench.filtering import WALK, Walk

RUNS, SEED, ENGAGEMENT = 10, 1, 0.06
DRIFT = 0.5
RIG = reference_rig()
EXACT = Instrument(range=0.0, range_ppm=0.0, angle_arcsec=0.0)


def _rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def machines(mounting: tuple[float, float, float] | None = None) -> Arms:
    """The four calibrations on the same machines."""
    options = Options(squeeze=SQUEEZE, installation_std=mounting) if mounting else None
    return simulated(RIG, RUNS, _rng(), best=True, options=options)


def told(arms: Arms, *names: str) -> Arms:
    """The tracker's controller knows the truth of these, too."""
    best = arms.arms[3].assumed
    known = replace(arms.arms[1].assumed, **{name: getattr(best, name) for name in names})
    changed = replace(arms.arms[1], assumed=known)
    return replace(arms, arms=(arms.arms[0], changed, *arms.arms[2:]))


def cases() -> Iterator[tuple[str, docking.Setup, Arms]]:
    """What is changed, and the docking with it."""
    arms = machines()
    base = docking.Setup(RIG, gears=GearPair(length=ENGAGEMENT))
    c = base.controller
    silent = replace(c.sensing, noise=0.0)
    walk = Walk.of(WALK, c.sensing.noise, 1.0 / c.sensing.rate)
    exact = replace(RIG, declared=replace(RIG.declared, positioner=0.0))
    yield "as it is", base, arms
    yield "sensors without noise", replace(base, controller=replace(c, sensing=silent)), arms
    yield "NCPs without error", replace(base, rig=exact), arms
    yield (
        "outer gear surveyed without error",
        replace(base, survey=replace(base.survey, instrument=EXACT)),
        arms,
    )
    yield "no friction", replace(base, gears=replace(base.gears, friction=0.0)), arms
    yield "half the speed", replace(base, speed=0.5 * base.speed), arms
    double = replace(
        c.impedance,
        stiffness=tuple(2.0 * k for k in c.impedance.stiffness),
        damping=tuple(2.0 * b for b in c.impedance.damping),
    )
    yield "K and B doubled", replace(base, controller=replace(c, impedance=double)), arms
    filtered = replace(c.sensing, gain=walk.gain)
    yield "Kalman filter", replace(base, controller=replace(c, sensing=filtered)), arms
    yield "tared", replace(base, controller=replace(c, tare=2.0)), arms
    yield (
        "tared, sensors without noise",
        replace(base, controller=replace(c, tare=2.0, sensing=silent)),
        arms,
    )
    yield "tracker knows the zeros", base, told(arms, "zero")
    yield "tracker knows mass and barycentre", base, told(arms, "mass", "barycentre")
    angles = told(arms, "zero", "mass", "barycentre")
    yield "tracker knows zeros, mass, barycentre", base, angles
    yield f"zeros drifted by {DRIFT:g} N since", base, drifted(arms, DRIFT, _rng())
    yield "the same, tracker knows zeros, mass, barycentre", base, drifted(angles, DRIFT, _rng())
    yield "mounted to 20, 20, 50 mrad", base, machines((0.02, 0.02, 0.05))


def _mean(values: FloatArray) -> str:
    return f"{values.mean():.2f}" if values.size else "–"


def main() -> None:
    """Print the table."""
    print(
        "# What sets the maxima\n\n"
        f"Made by `python -m benchmarks.docking`. Reference rig, {RUNS} runs, engagement cut to "
        f"{1e3 * ENGAGEMENT:g} mm.\nMeans of the maxima of the true contact, N and N·m, over runs "
        "that made contact (their number for\n*none*); self / tracker of the force with its "
        "standard error. Free space: mean deviation, mm.\n"
    )
    names = ("none", "tracker", "self", "perfect")
    print("| changed | " + " | ".join(names) + " | self / tracker | free space: tracker | self |")
    print("|---|" + "---|" * (len(names) + 3), flush=True)
    for what, setup, arms in cases():
        seed = np.random.SeedSequence(SEED)
        found = docking.docking(setup, arms, seed, SEED)
        cells = []
        for c, name in enumerate(names):
            force, torque = (found.average[c, found.touched[c], q] for q in (0, 1))
            count = f" ({force.size})" if name == "none" else ""
            cells.append(f"{_mean(force)}, {_mean(torque)}{count}")
        ratio = found.ratio(0, "self", "tracker")
        cells.append(f"{ratio.value:.2f} ± {ratio.std:.2f}")
        free = free_space.Setup(setup.rig, controller=setup.controller)
        length = free_space.free_space(free, arms, seed, SEED).length
        cells += [f"{1e3 * length[c, ..., 0].mean():.3f}" for c in (1, 2)]
        print(f"| {what} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
