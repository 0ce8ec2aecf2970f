"""Does `apply` state the uncertainty of a sample? Contact-free samples and known contacts.

    python -m benchmarks.apply_coverage [RUNS] > benchmarks/apply_coverage.md

Each run calibrates on a campaign of 16 postures and applies it to 8 further ones of the same rig,
every second one under a known contact. Counted are the samples of all dwells of those 8, from
0.8 s after the stop. Both logs carry a wall clock where nothing else is said; without one, zeros
are of unknown age.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

import tdfscal
from benchmarks.frame import declaring, flicker, heads, inside, numbers, row, scratch
from tdfscal.errors import TdfscalError
from tdfscal.files.writers.campaign import write_campaign
from tdfscal.records import Drift as DeclaredDrift
from tdfscal.records import FloatArray, Log, Rig, Series
from tdfscal.simulation import Campaign, Options, Recorder, reference_rig, simulate_campaign
from tdfscal.simulation.faults import Contact, Drift, Faults

USED, HELD = 16, 8
RATE = 100.0
#: s since 1970, a day in 2025.
CLOCK = 1.76e9
FORCE, MOMENT = (60.0, -40.0, 80.0), (12.0, -9.0, 5.0)
CONTACTS = tuple(Contact(k, FORCE, MOMENT) for k in range(USED, USED + HELD, 2))
RECORDER = Recorder(
    dwell=(4.0, 5.0), move=(1.5, 2.0), force_rate=RATE, position_rate=RATE, force_sd=(0.0, 0.0)
)
RIG = reference_rig()
NONE = Faults()
COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")

Noise = Callable[[np.random.Generator, int], FloatArray]


def white(rng: np.random.Generator, count: int) -> FloatArray:
    """(N, 3, 3), 2 N."""
    return 2.0 * rng.standard_normal((count, 3, 3))


def correlated(rng: np.random.Generator, count: int) -> FloatArray:
    """AR(1) with φ = 0.95, 2 N."""
    noise = rng.standard_normal((count + 200, 3, 3)) * np.sqrt(1 - 0.95**2)
    return np.asarray(2.0 * lfilter([1.0], [1.0, -0.95], noise, axis=0)[200:])


def slow(longer: int) -> Noise:
    """1/f, 2 N over both logs together."""
    return lambda rng, count: 2.0 * flicker(rng, count, longer)


def hum(frequency: float) -> Noise:
    """0.5 N of white noise and a hum of 3 N amplitude, of one phase per channel."""

    def noise(rng: np.random.Generator, count: int) -> FloatArray:
        phase = rng.uniform(-np.pi, np.pi, (3, 3))
        angle = 2 * np.pi * frequency * np.arange(count) / RATE
        swing = 3.0 * np.sin(angle[:, None, None] + phase)
        return np.asarray(swing + 0.5 * rng.standard_normal((count, 3, 3)))

    return noise


@dataclass(frozen=True)
class Case:
    """What disturbs, and what the rig file declares of it.

    step : N, resolution of the readings. drift : N, std of a slope of the zeros over both logs.
    clock : the logs carry one.
    """

    name: str
    noise: Noise = white
    rig: Rig = RIG
    real: Rig | None = None
    faults: Faults = NONE
    step: float = 0.0
    filter: str = "none"
    drift: float = 0.0
    clock: bool = True


def slopes(size: float, rng: np.random.Generator) -> tuple[Drift, ...]:
    return tuple(Drift(i, tuple(rng.normal(0.0, size, 3).tolist())) for i in range(3))


def quiet(rng: np.random.Generator, count: int) -> FloatArray:
    """(N, 3, 3), 0.2 N."""
    return 0.1 * white(rng, count)


CASES = (
    Case("white noise, 2 N"),
    Case("white, filter kalman", filter="kalman"),
    Case("white, filter smooth", filter="smooth"),
    Case("AR(0.95), 2 N", correlated),
    Case("AR(0.95), filter smooth", correlated, filter="smooth"),
    Case("1/f from 1/160 s, 2 N", slow(1)),
    Case("1/f from 1/160 s, smooth", slow(1), filter="smooth"),
    Case("1/f from 1/80 min, 2 N", slow(32)),
    Case("1/f from 1/80 min, smooth", slow(32), filter="smooth"),
    Case("1/f from 1/80 min, no clock", slow(32), clock=False),
    Case("hum of 3 N near 50 Hz", hum(49.2)),
    Case("hum of 3 N near 50 Hz, smooth", hum(49.2), filter="smooth"),
    Case("resolution 0.5 N, noise 0.05 N", lambda r, n: 0.025 * white(r, n), step=0.5),
    Case("quiet, friction 3 N·m at random", quiet, declaring(RIG, hinge_moment=3.0)),
    Case("quiet, hysteresis of 3 N·m a hinge", quiet,
         declaring(RIG, hinge_moment=float(3.0 * np.sqrt(3.0))), RIG, Faults(hysteresis=3.0)),
    Case("quiet, positioner 50 µm", quiet, declaring(RIG, positioner=5e-5)),
    Case("quiet, force noise 1 N a posture", quiet, declaring(RIG, force_noise=1.0)),
    Case("quiet, gain 0.2 %", quiet, declaring(RIG, force_sensitivity=2e-3)),
    Case("quiet, zeros drift by 3 N", quiet, drift=3.0),
    Case("the same, no clock", quiet, drift=3.0, clock=False),
)  # fmt: skip


def campaign(case: Case, rng: np.random.Generator) -> Campaign:
    """A campaign with its noise, and the rig as its file states it."""
    rig, faults = case.rig, replace(case.faults, contacts=CONTACTS)
    if case.drift:
        faults = replace(faults, drifts=slopes(case.drift, rng))
    options = Options(postures=USED + HELD, squeeze=300.0, recorder=RECORDER, faults=faults)
    plain = simulate_campaign(case.real or case.rig, options, rng)
    if case.drift:
        span = plain.log.force[0].time[-1] - plain.log.force[0].time[0]
        rig = replace(rig, drift=DeclaredDrift(time=case.drift / float(span)))
    noise = case.noise(rng, len(plain.log.force[0].time))
    force = []
    for i, series in enumerate(plain.log.force):
        value = series.value + noise[:, i]
        if case.step:
            value = case.step * np.round(value / case.step)
        force.append(Series(series.time, value))
    return replace(plain, rig=rig, log=replace(plain.log, force=tuple(force)))


def cut(log: Log, start: float, end: float, by: float = 0.0) -> Log:
    """A part of a log, and its clock set forward by so much."""

    def part(s: Series) -> Series:
        keep = (s.time >= start) & (s.time < end)
        return Series(s.time[keep] + by, s.value[keep])

    return replace(log, position=tuple(map(part, log.position)), force=tuple(map(part, log.force)))


def run(case: Case, seed: int, home: Path) -> dict[str, Any]:
    """Errors (N, 6) and standard uncertainties of the samples at rest, contact-free and not."""
    c = campaign(case, np.random.default_rng(seed))
    middle = 0.5 * (c.end[USED - 1] + c.start[USED])
    for place, start, end in (("used", 0.0, middle), ("held", middle, np.inf)):
        log = cut(c.log, start, end, CLOCK if case.clock else 0.0)
        write_campaign(replace(c, log=log), home / place, format="parquet")
    found = tdfscal.calibrate([home / "used"], trials=0)
    result = tdfscal.apply(found, [home / "held"], filter=case.filter)  # type: ignore[arg-type]
    columns = result.columns
    assert columns is not None
    begun = c.log.force[0].time
    time = columns["time"] - columns["time"][0] + begun[begun >= middle][0]
    value, std, common = (
        np.stack([columns[f"{prefix}{name}"] for name in COMPONENTS], axis=1)
        for prefix in ("", "u_", "u_cal_")
    )
    out: dict[str, Any] = {"filter": result.summary["filter"], "free": [], "touched": []}
    for k in range(USED, USED + HELD):
        rows = (time > c.start[k] + 0.8) & (time < c.end[k] - 0.1)
        touched = k % 2 == USED % 2
        truth = np.array([*FORCE, *MOMENT]) if touched else np.zeros(6)
        out["touched" if touched else "free"].append(
            (value[rows] - truth, std[rows], common[rows], value[rows].std(axis=0))
        )
    return out


def main() -> None:
    """Print the table."""
    (runs,) = numbers(12)
    print(
        "# Coverage of the contact wrench's uncertainty\n\n"
        f"`python -m benchmarks.apply_coverage {runs}`: {runs} campaigns a row; share of the "
        "samples' components\nwithin 1.96 u, contact-free and under a known contact; rms error / "
        "rms u; share of the variance u² that\nis u_cal²; for filters what is stated to be left of "
        "the noise, and what is, both within dwells.\n"
    )
    print(heads("noise", "contact-free", "known contact", "rms error / u", "u_cal² / u²", "left"))
    for case in CASES:
        shares: dict[str, list[float]] = {"free": [], "touched": []}
        squares, left, stated, refused = [], [], [], 0
        for seed in range(runs):
            try:
                with scratch() as home:
                    got = run(case, 100 + seed, home)
            except TdfscalError:
                refused += 1
                continue
            for kind, share in shares.items():
                for error, std, common, scatter in got[kind]:
                    share.append(inside(error, std))
                    squares.append([np.mean((error / std) ** 2), np.mean((common / std) ** 2)])
                    left.append(scatter)
            if got["filter"] is not None:
                stated.append(got["filter"]["noise"] * got["filter"]["noise_left"])
        ratio, part = np.mean(squares, axis=0)
        words = ""
        if stated:
            real = np.sqrt(np.mean(np.square(left), axis=0)[:3].mean() / 3)
            words = f"{np.mean(stated):.2f} N, {real:.2f} N"
        covered = [f"{np.mean(share):.1%}" for share in shares.values()]
        line = row(case.name, *covered, f"{np.sqrt(ratio):.2f}", f"{part:.2f}", words)
        print(line + (f" {refused} refused" if refused else ""), flush=True)


if __name__ == "__main__":
    main()
