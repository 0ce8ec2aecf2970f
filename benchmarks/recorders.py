"""Campaigns recorded apart, by two clocks, against the same samples on one clock.

    python -m benchmarks.recorders rest | motion | wrong | cost [--runs N] [--first SEED]

Each run draws a rig's truth, a campaign and two recorders: 20 to 2000 Hz each, the forces' clock
apart by up to 1.8e9 s of either sign and running at ± 50 ppm, stamps that jitter by up to 1 ms or a
fifth of their interval, a late begin, and in every third run a gap of 2 s in the forces. The same
samples are calibrated on one clock, too: with the clock stated as exact.

apart : largest change of an angle's turn against that, in its standard uncertainty. offset : error
in its stated standard uncertainty. error : RMS of the turns' errors over their stated standard
uncertainties. d²/3n, inside : of the truth.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.frame import errors, heads, inside, over, rms, row, scratch, show
from tdfscal import calibrate
from tdfscal.dwells import find_dwells
from tdfscal.errors import TdfscalError
from tdfscal.files.writers.campaign import write_run
from tdfscal.logs import concatenate
from tdfscal.logs.streams import on_one_clock
from tdfscal.model.dynamics import DELAY, RATE
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.records import ClockPrior, FloatArray, Log, RecorderClock, Rig, Series, UncertainValue
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.simulation import MOVING, Options, Recorder, Run, reference_rig, run
from tests.cli.apart import Apart, recorded_apart, write_apart

RATES = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0)
LAGS = (0.0, 3.7, 600.0, 81234.5, 1.8e9)


def played(scenario: str, seed: int, rate: float, postures: int = 12) -> Run:
    rng = np.random.default_rng(seed)
    if scenario == "motion":
        return run(reference_rig(), scenario, replace(MOVING["motion"], rate=rate), rng)
    recorder = Recorder(force_rate=rate, position_rate=rate)
    return run(reference_rig(), "self", Options(postures=postures, recorder=recorder), rng)


def drawn(rng: np.random.Generator, gap: bool) -> Apart:
    rates = rng.choice(RATES, 2)
    begin = float(rng.uniform(15.0, 40.0))
    return Apart(
        offset=float(rng.choice(LAGS) * rng.choice([-1.0, 1.0])) + float(rng.uniform(-1.0, 1.0)),
        rate=float(rng.uniform(-50e-6, 50e-6)),
        late=float(rng.uniform(0.0, 3.0)),
        jitter=min(1e-3, 0.2 / float(rates[1])),
        gap=(begin, begin + 2.0) if gap else None,
        position_rate=float(min(rates[0], 500.0)),  # no servo is logged faster
        force_rate=float(rates[1]),
    )


def calibrated(
    rig: Rig, parts: tuple[Log, Log], clock: ClockPrior
) -> tuple[SelfCalibration | MotionCalibration, RecorderClock]:
    """Calibrate from two recordings by their moves or dwells."""
    sources = [
        (name, prior, partial(iter, [part]))
        for name, prior, part in zip("ab", (ClockPrior(), clock), parts, strict=True)
    ]
    log = concatenate(on_one_clock(sources))
    dwells = find_dwells(log)
    rng = np.random.default_rng(0)
    if len(dwells) >= 5:
        return self_calibrate(rig, dwells, rng=rng, max_trials=0), log.clocks[0]
    delay = UncertainValue(np.zeros(2), np.array([np.inf, 1e-4]))
    return calibrate_moving(rig, slow_streams([log], rig.capacity), delay), log.clocks[0]


def rotations(own: SelfCalibration | MotionCalibration) -> FloatArray:
    """Rotations (n, 3, 3) found."""
    return (own.fit.state.still if isinstance(own, MotionCalibration) else own.fit.state).rotation


def campaign(seed: int, scenario: str) -> dict[str, Any]:
    rng = np.random.default_rng([seed, 31])
    how = drawn(rng, seed % 3 == 0)
    assert how.position_rate is not None
    assert how.force_rate is not None
    of = played(scenario, seed, max(how.position_rate, how.force_rate, 100.0))
    recorded = of.campaign or of.moving
    assert recorded is not None
    exact = ClockPrior(UncertainValue.exact(0.0), 0.0)
    same = replace(how, offset=0.0, rate=0.0)
    found, spent = [], []
    for recorders, prior in ((same, exact), (how, ClockPrior())):
        parts = recorded_apart(recorded.log, recorders, np.random.default_rng(seed))
        begin = time.process_time()
        try:
            found.append(calibrated(of.rig, parts, prior))
        except TdfscalError as error:
            return {"seed": seed, "how": how, "failed": f"{len(found) + 1}: {error}"}
        spent.append(time.process_time() - begin)
    (one, _), (two, clock) = found
    first, second = rotations(one), rotations(two)
    e, std, distance = errors(of.truth.rotation, second, two.uncertainty.covariance)
    e1, std1, _ = errors(of.truth.rotation, first, one.uncertainty.covariance)
    offset, offset_std, rate, rate_std = clock.offset, clock.offset_std, clock.rate, clock.rate_std
    if isinstance(two, MotionCalibration):
        moving, moving_std = two.fit.state.moving, two.moving_std
        offset += moving.delay - 30.0 * moving.rate - 0.005
        offset_std = float(np.hypot(moving_std[DELAY], 30.0 * moving_std[RATE]))
        rate, rate_std = rate + moving.rate, float(moving_std[RATE])
    return {
        "seed": seed,
        "how": how,
        "accepted": (not one.reasons, not two.reasons),
        "change": float(np.abs(so3.log(first @ np.swapaxes(second, 1, 2)).ravel() / std).max()),
        "offset": (offset - how.offset) / offset_std,
        "offset std": offset_std,
        "rate": (rate - how.rate) / rate_std,
        "z": (e / std).tolist(),
        "z one": (e1 / std1).tolist(),
        "d2": distance,
        "cost": spent[1] / spent[0],
    }


def table(results: list[dict[str, Any]]) -> str:
    good = [r for r in results if "failed" not in r]
    z, z1 = (np.concatenate([r[key] for r in good]) for key in ("z", "z one"))
    within, in_rate = (
        100 * np.mean([abs(r[key]) <= 3.0 for r in good]) for key in ("offset", "rate")
    )
    one, apart = (sum(r["accepted"][k] for r in good) for k in (0, 1))
    change = [r["change"] for r in good]
    return row(
        len(results), f"{apart} ({one})", f"{np.median(change):.3f}, {max(change):.2f}",
        f"{within:.0f} %", f"{1e3 * np.median([r['offset std'] for r in good]):.1f}",
        f"{in_rate:.0f} %", f"{rms(z):.2f} ({rms(z1):.2f})",
        f"{np.mean([r['d2'] for r in good]):.2f}",
        f"{100 * inside(z, np.ones_like(z)):.1f} %",
        f"{np.median([r['cost'] for r in good]):.2f}",
    )  # fmt: skip


HEAD = heads(
    "runs", "accepted (one clock)", "apart: median, worst, σ", "offset within 3 u", "u, ms",
    "rate within 3 u", "error/σ (one clock)", "d²/3n", "inside 95 %", "cost",
)  # fmt: skip


def wrong(seed: int, what: str) -> str:
    """How a pair of recordings is refused that do not belong together."""
    of, other = played("self", seed, 100.0), played("self", seed + 5000, 100.0)
    assert of.campaign is not None
    assert other.campaign is not None
    how = Apart(offset=3.7, rate=20e-6)
    moves, loads = recorded_apart(of.campaign.log, how, np.random.default_rng(seed))
    if what == "other campaign":
        loads = recorded_apart(other.campaign.log, how, np.random.default_rng(seed))[1]
    force = loads.force
    if what == "swapped columns":
        force = (force[1], force[0], *force[2:])
    if what == "reversed time":
        force = tuple(Series(s.time, np.ascontiguousarray(s.value[::-1])) for s in force)
    with scratch() as place:
        write_apart(place, of.rig, moves, replace(loads, force=force))
        try:
            found = calibrate([place], trials=0)
        except TdfscalError as error:
            return f"exit {error.exit_status}"
    return "accepted" if found.accepted else "rejected"


def cost(seed: int, postures: int) -> tuple[float, float]:
    """Processor time of the command on one file with all samples, and on two recorders', s."""
    of = played("self", seed, 250.0, postures)
    assert of.campaign is not None
    apart = recorded_apart(of.campaign.log, Apart(3.7, 20e-6), np.random.default_rng(seed))
    with scratch() as place:
        folders = place / "one", place / "two"
        write_run(of, folders[0], format="csv")
        write_apart(folders[1], of.rig, *apart)
        spent = []
        for folder in folders:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(["tdfscal", "calibrate", str(folder)], capture_output=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return spent[0], spent[1]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["rest", "motion", "wrong", "cost"])
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.runs)
    if given.what in ("rest", "motion"):
        scenario = "motion" if given.what == "motion" else "self"
        results = []
        for seed in seeds:
            results.append(campaign(seed, scenario))
            print(results[-1], flush=True)
        print(f"{HEAD}\n{table(results)}")
    elif given.what == "wrong":
        print(heads("pair", "runs", "outcome"))
        for what in ("other campaign", "swapped columns", "reversed time"):
            ends = over(partial(wrong, what=what), seeds)
            told = ", ".join(f"{ends.count(end)} {end}" for end in sorted(set(ends)))
            show(what, len(ends), told)
    else:
        print(heads("postures", "run", "one file, s", "two recorders, s", "ratio"))
        for postures in (12, 60):
            for seed in seeds:
                one, two = cost(seed, postures)
                show(postures, seed, *(f"{figure:.2f}" for figure in (one, two, two / one)))


if __name__ == "__main__":
    main()
