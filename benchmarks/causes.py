"""Confusion tables of causes: what is wrong, and what `calibrate` and `validate` say it is.

    python -m benchmarks.causes [RUNS] [calibrate | validate | tared] > benchmarks/causes.md

Reference rig, squeeze 150 N, postures of 0.1 N noise; `calibrate` on 24 postures with the fault in,
`validate` on 8 postures with it after a calibration on 24 without; `tared` the same on 6 postures
whose zeros are drawn anew. Right: the true cause is named
first, or among those that are said to be as likely. Crosstalk counts as gain; 1/f noise is a drift
too.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.model.calibrated import Calibrated
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import joint_posterior
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import (
    Contact,
    Crosstalk,
    Drift,
    Faults,
    Gain,
    Options,
    Slip,
    ZeroShift,
    reference_rig,
    simulate_dwells,
)
from tdfscal.simulation.faults import Walk, Warming
from tdfscal.validation.residual_wrench import validate

USED, HELD, FEW = 24, 8, 6
RIG = reference_rig()
NONE = Faults()
Noise = Callable[[np.random.Generator, int], FloatArray]


def flicker(rng: np.random.Generator, count: int) -> FloatArray:
    """1/f noise (K, n, 3) between postures, N."""
    f = np.fft.rfftfreq(4 * count)[1:, None, None]
    wave = rng.standard_normal((len(f), 3, 3)) + 1j * rng.standard_normal((len(f), 3, 3))
    noise = np.fft.irfft(np.concatenate([np.zeros((1, 3, 3)), wave / np.sqrt(f)]), axis=0)
    return np.asarray(0.5 * noise[:count] / noise.std(axis=0))


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
    """The rig whose mass or barycentre is another."""
    return replace(
        RIG,
        **{  # type: ignore[arg-type]
            name: UncertainValue(value, getattr(RIG, name).std) for name, value in changes.items()
        },
    )


def really(**changes: float) -> Rig:
    return replace(RIG, declared=replace(RIG.declared, **changes))


def both() -> Iterator[Fault]:
    """Faults of a whole log, for either command."""
    for size in (1e-3, 2e-3, 3e-3, 1e-2):
        gain = Faults(gains=(Gain(0, (size,) * 3),))
        yield Fault(f"gain of ncp1 +{100 * size:g} %", ("gain ncp1",), gain)
    yield Fault(
        "gain of ncp1 along z +0.3 %", ("gain ncp1",), Faults(gains=(Gain(0, (0, 0, 3e-3)),))
    )
    yield Fault(
        "crosstalk of ncp1 0.5 %", ("gain ncp1",), Faults(crosstalk=(Crosstalk(0, (5e-3,) * 3),))
    )
    yield Fault("forces scatter by 0.5 N", ("force noise",), real=really(force_noise=0.5))
    yield Fault("ncp1 scatters by 0.6 N", ("noise of ncp1",), noise=one_sensor)
    yield Fault("1/f noise of 0.5 N", ("force noise", "drift", "walk"), noise=flicker)
    yield Fault("one posture in contact, 30 N", ("contact",),
                Faults(contacts=(Contact(USED - 2, (10.0, -15.0, 25.0)),
                                 Contact(USED + 2, (10.0, -15.0, 25.0)))))  # fmt: skip
    yield Fault("mass +1 kg", ("load",), real=moved(mass=RIG.mass.value + 1.0))
    off = RIG.barycentre.value + np.array([6e-3, -5e-3, 0.0])
    yield Fault("barycentre 8 mm off", ("load", "barycentre"), real=moved(barycentre=off))


def in_course(middle: int) -> Iterator[Fault]:
    """Faults that come or grow within a log, whose middle is at a posture."""
    yield Fault(
        "zero of ncp1 drifts by 4 N",
        ("drift ncp1", "drift"),
        Faults(drifts=(Drift(0, (4, -4, 4)),)),
    )
    yield Fault("zero of ncp1 jumps by 4 N", ("jump ncp1", "refused: zero-tared"),
                Faults(zero_shifts=(ZeroShift(0, middle, (4, -4, 4)),)))  # fmt: skip
    yield Fault(
        "ncp1 slips by 4 mrad", ("slip ncp1",), Faults(slips=(Slip(0, middle, (4e-3, 0, 0)),))
    )
    yield Fault("zeros walk by 1 N", ("walk",), Faults(walks=tuple(Walk(i, 1.0) for i in range(3))))
    slope = tuple((0.5 * s, -0.4 * s, 0.6 * s) for s in (1.0, -1.0, 0.5))
    yield Fault("zeros follow 8 K", ("temperature", "drift"),
                Faults(warming=Warming(8.0, slope)))  # fmt: skip


def of_calibrate() -> Iterator[Fault]:
    """Faults that `calibrate` meets."""
    yield from both()
    zero = RIG.zero.value.copy()
    zero[0] = (4.0, -3.0, 5.0)
    yield Fault("zero of ncp1 7 N off", ("zero ncp1",),
                real=replace(RIG, zero=UncertainValue(zero, RIG.zero.std)))  # fmt: skip
    yield Fault(
        "base 1.5 mrad (std) off level", ("tilt",), real=replace(RIG, gravity_tilt_std=1.5e-3)
    )
    yield Fault(
        "hinge friction 1.5 N·m at random", ("hinge friction",), real=really(hinge_moment=1.5)
    )
    yield Fault("hysteresis of 1 N·m a hinge", ("friction",), Faults(hysteresis=1.0))
    yield Fault("NCPs repeat 100 µm", ("position noise",), real=really(positioner=1e-4))
    yield from in_course(12)


def of_validate() -> Iterator[Fault]:
    """Faults that `validate` meets: the rig was sound when it was calibrated."""
    yield from both()
    for axis in range(3):
        turn = tuple(2e-3 * (a == axis) for a in range(3))
        yield Fault(f"ncp1 turned by 2 mrad about {'xyz'[axis]}", ("turned ncp1",),
                    Faults(slips=(Slip(0, USED, turn),)))  # type: ignore[arg-type]  # fmt: skip
    yield Fault("zero of ncp1 3.7 N off", ("zero ncp1",),
                Faults(zero_shifts=(ZeroShift(0, USED, (2.0, -1.0, 3.0)),)))  # fmt: skip
    touched = tuple(Contact(USED + k, (10.0, -20.0, 15.0)) for k in (1, 4))
    yield Fault("two postures in contact", ("contact",), Faults(contacts=touched))
    yield Fault("hinge friction 1.5 N·m at random", ("hinge friction",),
                real=really(hinge_moment=1.5))  # fmt: skip
    yield Fault(
        "base 1.5 mrad (std) off level", ("tilt",), real=replace(RIG, gravity_tilt_std=1.5e-3)
    )
    yield from in_course(USED + HELD // 2)


def of_tared() -> Iterator[Fault]:
    """Faults after which the sensors are tared."""
    for axis in range(3):
        turn = tuple(4e-3 * (a == axis) for a in range(3))
        yield Fault(f"ncp1 turned by 4 mrad about {'xyz'[axis]}", ("turned ncp1",),
                    Faults(slips=(Slip(0, USED, turn),)), tared=True)  # type: ignore[arg-type]  # fmt: skip
    for fault in both():
        if "1 %" in fault.name or "mass" in fault.name or "contact" in fault.name:
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


def said_by_calibrate(fault: Fault, dwells: Dwells) -> list[str]:
    """Names of the suspected causes, the likeliest first."""
    try:
        result = calibrated(fault.stated, rows_of(dwells, slice(0, USED)))
    except TdfscalError as error:
        return [f"refused: {error.what[:30]}"]
    said = [named(s.kind, s.support, _OF_CALIBRATE) for s in result.suspicions]
    if result.channels is not None and not said:
        worst = np.argwhere(result.channels > 1.3)
        sensors = {int(i) for i, _ in worst}
        said = (
            [f"noise of {RIG.supports[i]}" for i in sensors]
            if len(sensors) < 3
            else ["force noise"]
        )
    if result.rejected and not said:
        said = ["contact"]
    return said


def calibrated(rig: Rig, dwells: Dwells) -> SelfCalibration:
    return self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)


def sound_calibration(dwells: Dwells) -> Calibrated:
    result = calibrated(RIG, rows_of(dwells, slice(0, USED)))
    return joint_posterior(result.fit, result.uncertainty.covariance)


def said_by_validate(given: Calibrated, dwells: Dwells) -> list[str]:
    verdict = validate(given, rows_of(dwells, slice(USED, None)))
    if verdict.holds:
        return []
    return [named(c.kind, c.support, _OF_VALIDATE) for c in verdict.suspected] or [
        "no single cause"
    ]


def table(command: str, faults: list[Fault], runs: int) -> None:
    """Print one table, a row per fault."""
    print(f"\n## {command}\n")
    print(
        "| fault | said at all | right first | right or tied | causes said | what else came first |"
    )
    print("|---|---|---|---|---|---|", flush=True)
    total = Counter[str]()
    for seed, fault in enumerate(faults):
        count, wrong, length = Counter[str](), Counter[str](), 0
        for sound, faulty in campaigns(fault, runs, seed):
            try:
                if command == "calibrate":
                    said = said_by_calibrate(fault, faulty)
                else:
                    said = said_by_validate(sound_calibration(sound), faulty)
            except TdfscalError as error:
                said = [f"refused: {error.what[:10]}"]
            if not said:
                continue
            length += len(said)
            count["said"] += 1
            count["first"] += matches(said[0], fault.right)
            count["right"] += any(matches(name, fault.right) for name in said)
            if not matches(said[0], fault.right):
                wrong[said[0]] += 1
        total += count
        share = [f"{count[k]} of {count['said']}" for k in ("first", "right")]
        others = ", ".join(f"{name} {times}" for name, times in wrong.most_common(3))
        print(
            f"| {fault.name} | {count['said']} of {runs} | {share[0]} | {share[1]} "
            f"| {length / max(count['said'], 1):.1f} | {others} |",
            flush=True,
        )
    if total["said"]:
        print(
            f"\nRight first in {total['first'] / total['said']:.1%}, right or tied in "
            f"{total['right'] / total['said']:.1%} of the {total['said']} that were noticed."
        )


def false_alarms(command: str, runs: int) -> None:
    """Sound campaigns in which a cause is named."""
    said: Counter[str] = Counter()
    fault = Fault("none", (), tared=command == "tared")
    for sound, _ in campaigns(fault, runs, 777):
        if command == "calibrate":
            found = said_by_calibrate(fault, sound)
        else:
            found = said_by_validate(sound_calibration(sound), sound)
        if found:
            said[found[0]] += 1
    share = sum(said.values())
    print(f"\nFalse alarms: {share} of {runs} sound ones ({share / runs:.1%}). {dict(said) or ''}")


FAULTS = {"calibrate": of_calibrate, "validate": of_validate, "tared": of_tared}


def main() -> None:
    """Print the tables."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    commands = sys.argv[2:] or list(FAULTS)
    print(f"# Causes named right\n\n`python -m benchmarks.causes {runs}`: {runs} campaigns a row.")
    for command in commands:
        table(command, list(FAULTS[command]()), runs)
        false_alarms(command, 10 * runs)


if __name__ == "__main__":
    main()
