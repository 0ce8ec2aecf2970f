"""Confusion tables of causes: what is wrong, and what `calibrate` and `validate` say it is.

    python -m benchmarks.causes [RUNS] [calibrate | validate | tared] > benchmarks/causes.md

Reference rig, squeeze 150 N, postures of 0.1 N noise; `calibrate` on 24 postures with the fault in,
`validate` on 8 postures with it after a calibration on 24 without; `tared` the same on 6 postures
whose zeros are drawn anew. Right: the true cause is named
first, or among those that are said to be as likely. Crosstalk counts as gain; 1/f noise is a drift
too.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.frame import declaring, flicker, heads, numbers, show, tally
from tdfscal.errors import TdfscalError
from tdfscal.model.calibrated import Calibrated
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.simulation import Faults, Options, ZeroShift, reference_rig, simulate_dwells
from tdfscal.simulation.faults import Contact, Drift, Gain, Slip, Walk, Warming
from tdfscal.validation.residual_wrench import validate

USED, HELD, FEW = 24, 8, 6
RIG = reference_rig()
NONE = Faults()
Noise = Callable[[np.random.Generator, int], FloatArray]


def slow(rng: np.random.Generator, count: int) -> FloatArray:
    """1/f noise (K, n, 3) between postures, N."""
    return 0.5 * flicker(rng, count, 4)


def one_sensor(rng: np.random.Generator, count: int) -> FloatArray:
    out = np.zeros((count, 3, 3))
    out[:, 0] = 0.6 * rng.standard_normal((count, 3))
    return out


@dataclass(frozen=True)
class Fault:
    """What is wrong: the rig as it really is, what happens, noise beside; and its right names."""

    name: str
    right: tuple[str, ...]
    faults: Faults = NONE
    real: Rig = RIG
    stated: Rig = RIG
    noise: Noise | None = None
    tared: bool = False


def moved(**changes: FloatArray) -> Rig:
    """The rig whose zeros, mass or barycentre are others."""
    return replace(
        RIG,
        **{  # type: ignore[arg-type]
            name: UncertainValue(value, getattr(RIG, name).std) for name, value in changes.items()
        },
    )


def both() -> Iterator[Fault]:
    """Faults of a whole log, for either command."""
    for size in (1e-3, 2e-3, 3e-3, 1e-2):
        gain = Faults(gains=(Gain(0, (size,) * 3),))
        yield Fault(f"gain of ncp1 +{100 * size:g} %", ("gain ncp1",), gain)
    upward, cross = Gain(0, (0, 0, 3e-3)), Gain(0, crosstalk=(5e-3,) * 3)
    yield Fault("gain of ncp1 along z +0.3 %", ("gain ncp1",), Faults(gains=(upward,)))
    yield Fault("crosstalk of ncp1 0.5 %", ("gain ncp1",), Faults(gains=(cross,)))
    scatter = declaring(RIG, force_noise=0.5)
    yield Fault("forces scatter by 0.5 N", ("force noise",), real=scatter)
    yield Fault("ncp1 scatters by 0.6 N", ("noise of ncp1",), noise=one_sensor)
    yield Fault("1/f noise of 0.5 N", ("force noise", "drift", "walk"), noise=slow)
    touched = tuple(Contact(k, (10.0, -15.0, 25.0)) for k in (USED - 2, USED + 2))
    yield Fault("one posture in contact, 30 N", ("contact",), Faults(contacts=touched))
    yield Fault("mass +1 kg", ("load",), real=moved(mass=RIG.mass.value + 1.0))
    off = RIG.barycentre.value + np.array([6e-3, -5e-3, 0.0])
    yield Fault("barycentre 8 mm off", ("load", "barycentre"), real=moved(barycentre=off))


def in_course(middle: int) -> Iterator[Fault]:
    """Faults that come or grow within a log, whose middle is at a posture."""
    drift, jump = Drift(0, (4, -4, 4)), ZeroShift(0, middle, (4, -4, 4))
    yield Fault("zero of ncp1 drifts by 4 N", ("drift ncp1", "drift"), Faults(drifts=(drift,)))
    jumped = ("jump ncp1", "refused: zero-tared")
    yield Fault("zero of ncp1 jumps by 4 N", jumped, Faults(zero_shifts=(jump,)))
    slip = Slip(0, middle, (4e-3, 0, 0))
    yield Fault("ncp1 slips by 4 mrad", ("slip ncp1",), Faults(slips=(slip,)))
    yield Fault("zeros walk by 1 N", ("walk",), Faults(walks=tuple(Walk(i, 1.0) for i in range(3))))
    warming = Warming(8.0, tuple((0.5 * s, -0.4 * s, 0.6 * s) for s in (1.0, -1.0, 0.5)))
    yield Fault("zeros follow 8 K", ("temperature", "drift"), Faults(warming=warming))


def turned(size: float) -> Iterator[Fault]:
    """A sensor that was turned after the calibration, about each axis."""
    for axis, turn in zip("xyz", size * np.eye(3), strict=True):
        slip = Slip(0, USED, (turn[0], turn[1], turn[2]))
        name = f"ncp1 turned by {1e3 * size:g} mrad about {axis}"
        yield Fault(name, ("turned ncp1",), Faults(slips=(slip,)))


TILTED = Fault("base 1.5 mrad (std) off level", ("tilt",),
               real=replace(RIG, gravity_tilt_std=1.5e-3))  # fmt: skip
STICKING = Fault("hinge friction 1.5 N·m at random", ("hinge friction",),
                 real=declaring(RIG, hinge_moment=1.5))  # fmt: skip


def of_calibrate() -> Iterator[Fault]:
    """Faults that `calibrate` meets."""
    yield from both()
    zero = RIG.zero.value.copy()
    zero[0] = (4.0, -3.0, 5.0)
    yield Fault("zero of ncp1 7 N off", ("zero ncp1",), real=moved(zero=zero))
    yield TILTED
    yield STICKING
    yield Fault("hysteresis of 1 N·m a hinge", ("friction",), Faults(hysteresis=1.0))
    far = declaring(RIG, positioner=1e-4)
    yield Fault("NCPs repeat 100 µm", ("position noise",), real=far)
    yield from in_course(12)


def of_validate() -> Iterator[Fault]:
    """Faults that `validate` meets: the rig was sound when it was calibrated."""
    yield from both()
    yield from turned(2e-3)
    shift = ZeroShift(0, USED, (2.0, -1.0, 3.0))
    yield Fault("zero of ncp1 3.7 N off", ("zero ncp1",), Faults(zero_shifts=(shift,)))
    touched = tuple(Contact(USED + k, (10.0, -20.0, 15.0)) for k in (1, 4))
    yield Fault("two postures in contact", ("contact",), Faults(contacts=touched))
    yield STICKING
    yield TILTED
    yield from in_course(USED + HELD // 2)


def of_tared() -> Iterator[Fault]:
    """Faults after which the sensors are tared."""
    kept = (f for f in both() if any(word in f.name for word in ("1 %", "mass", "contact")))
    for fault in (*turned(4e-3), *kept):
        yield replace(fault, tared=True)


_OF_CALIBRATE = {
    "sensitivity": "gain", "mass": "load", "barycentre": "barycentre", "sensor noise": "noise of",
    "parabola": "drift", "all drift": "drift", "all parabola": "drift",
    "all temperature": "temperature", "all walk": "walk",
}  # fmt: skip
_OF_VALIDATE = {
    "sensor turned": "turned", "load changed": "load", "zero drifted": "zero",
    "gain changed": "gain", "base tilted": "tilt", "hinges stick": "hinge friction",
    "zeros wander": "walk", "sensor slipped": "slip", "zero jumped": "jump", "zeros drift": "drift",
    "zeros follow temperature": "temperature",
}  # fmt: skip


def named(kind: str, support: int | None, table: dict[str, str]) -> str:
    if kind == "noise grown":
        return "force noise" if support is None else f"noise of {RIG.supports[support]}"
    word = table.get(kind, kind)
    return word if support is None else f"{word} {RIG.supports[support]}"


def matches(name: str, right: tuple[str, ...]) -> bool:
    return any(name == r or name.startswith(f"{r} ") for r in right)


def campaigns(fault: Fault, runs: int, seed: int) -> Iterator[tuple[Dwells, Dwells]]:
    """Sound and faulty dwells, alike to the last random number but for the fault."""
    rng = np.random.default_rng(9000 + seed)
    options = Options(postures=USED + HELD, squeeze=150.0)
    sound, faulty = (
        simulate_dwells(real, replace(options, faults=faults), np.random.default_rng(seed), runs)
        for real, faults in ((RIG, NONE), (fault.real, fault.faults))
    )
    for run in range(runs):
        wrong = faulty.dwells(run)
        if fault.noise is not None:
            wrong = replace(wrong, force=wrong.force + fault.noise(rng, USED + HELD))
        right = sound.dwells(run)
        if fault.tared:
            shift = rng.normal(RIG.zero.value, RIG.zero.std) - faulty.truth.zero[run]
            wrong, right = tared(wrong, shift), tared(right, shift)
        yield right, wrong


def tared(dwells: Dwells, shift: FloatArray) -> Dwells:
    """Dwells whose zeros are others after the calibration, and fewer of them."""
    force = dwells.force.copy()
    force[USED:] += shift
    return rows_of(replace(dwells, force=force), slice(0, USED + FEW))


def rows_of(dwells: Dwells, rows: slice) -> Dwells:
    per_dwell = ("start", "end", "position", "position_cov", "force", "force_cov", "force_min",
                 "force_max", "count", "effective")  # fmt: skip
    changes = {name: getattr(dwells, name)[rows] for name in per_dwell}
    temperature = None if dwells.temperature is None else dwells.temperature[rows]
    return replace(dwells, temperature=temperature, **changes)


def said(command: str, fault: Fault, sound: Dwells, dwells: Dwells) -> list[str]:
    """What the command names of a sound campaign's faulty twin, the likeliest first."""
    if command == "calibrate":
        return said_by_calibrate(fault, dwells)
    try:
        return said_by_validate(sound_calibration(sound), dwells)
    except TdfscalError as error:
        return [f"refused: {error.what[:10]}"]


def said_by_calibrate(fault: Fault, dwells: Dwells) -> list[str]:
    """Names of the suspected causes, the likeliest first."""
    try:
        result = calibrated(fault.stated, rows_of(dwells, slice(0, USED)))
    except TdfscalError as error:
        return [f"refused: {error.what[:30]}"]
    said = [named(s.kind, s.support, _OF_CALIBRATE) for s in result.suspicions]
    if result.rejected and not said:
        said = ["contact"]
    return said


def calibrated(rig: Rig, dwells: Dwells) -> SelfCalibration:
    return self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)


def sound_calibration(dwells: Dwells) -> Calibrated:
    result = calibrated(RIG, rows_of(dwells, slice(0, USED)))
    return result.calibrated


def said_by_validate(given: Calibrated, dwells: Dwells) -> list[str]:
    verdict = validate(given, rows_of(dwells, slice(USED, None)))
    if verdict.holds:
        return []
    found = [named(c.kind, c.support, _OF_VALIDATE) for c in verdict.suspected]
    return found or ["no single cause"]


def table(command: str, faults: list[Fault], runs: int) -> None:
    """Print one table, a row per fault."""
    print(f"\n## {command}\n")
    print(heads("fault", "said at all", "right first", "right or tied", "causes said",
                "what else came first"), flush=True)  # fmt: skip
    total = Counter[str]()
    for seed, fault in enumerate(faults):
        count, wrong, length = Counter[str](), Counter[str](), 0
        for sound, faulty in campaigns(fault, runs, seed):
            found = said(command, fault, sound, faulty)
            if not found:
                continue
            right = [matches(name, fault.right) for name in found]
            length += len(found)
            count.update(said=1, first=int(right[0]), right=int(any(right)))
            wrong.update([] if right[0] else found[:1])
        total += count
        share = [f"{count[k]} of {count['said']}" for k in ("first", "right")]
        each = f"{length / max(count['said'], 1):.1f}"
        show(fault.name, f"{count['said']} of {runs}", *share, each, tally(wrong, 3))
    if total["said"]:
        print(
            f"\nRight first in {total['first'] / total['said']:.1%}, right or tied in "
            f"{total['right'] / total['said']:.1%} of the {total['said']} that were noticed."
        )


def false_alarms(command: str, runs: int) -> None:
    """Sound campaigns in which a cause is named."""
    fault, wrong = Fault("none", (), tared=command == "tared"), Counter[str]()
    for sound, _ in campaigns(fault, runs, 777):
        wrong.update(said(command, fault, sound, sound)[:1])
    share = wrong.total()
    print(f"\nFalse alarms: {share} of {runs} sound ones ({share / runs:.1%}). {dict(wrong) or ''}")


FAULTS = {"calibrate": of_calibrate, "validate": of_validate, "tared": of_tared}


def main() -> None:
    """Print the tables."""
    (runs,) = numbers(60)
    print(f"# Causes named right\n\n`python -m benchmarks.causes {runs}`: {runs} campaigns a row.")
    for command in sys.argv[2:] or FAULTS:
        table(command, list(FAULTS[command]()), runs)
        false_alarms(command, 10 * runs)


if __name__ == "__main__":
    main()
