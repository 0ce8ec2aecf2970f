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
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.frame import heads, over, row
from tdfscal import calibrate
from tdfscal.errors import TdfscalError
from tdfscal.files.writers.apart import write_apart
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Series
from tdfscal.simulation import MOVING, Options, Recorder, Run, reference_rig, run
from tdfscal.simulation.recorded_apart import Apart, recorded_apart

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


def one_clock(folder: Path) -> None:
    """State the second clock as that of the first."""
    document = yaml.safe_load((folder / "rig.yaml").read_text())
    document["log"][1]["clock"] = {"offset": {"value": 0.0, "std": 0.0}, "rate_std": 0.0}
    (folder / "rig.yaml").write_text(yaml.safe_dump(document, sort_keys=False))


def campaign(seed: int, scenario: str) -> dict[str, Any]:
    rng = np.random.default_rng([seed, 31])
    how = drawn(rng, seed % 3 == 0)
    assert how.position_rate is not None
    assert how.force_rate is not None
    of = played(scenario, seed, max(how.position_rate, how.force_rate, 100.0))
    recorded = of.campaign or of.moving
    assert recorded is not None
    same = replace(how, offset=0.0, rate=0.0)
    with tempfile.TemporaryDirectory() as place:
        found: dict[str, Any] = {}
        for name, recorders in (("one", same), ("two", how)):
            folder = Path(place) / name
            parts = recorded_apart(recorded.log, recorders, np.random.default_rng(seed))
            write_apart(folder, of.rig, *parts)
            if name == "one":
                one_clock(folder)
            begin = time.process_time()
            try:
                found[name] = calibrate([folder], trials=0)
            except TdfscalError as error:
                return {"seed": seed, "how": how, "failed": f"{name}: {error}"}
            found[f"{name} s"] = time.process_time() - begin
    one, two = found["one"], found["two"]
    cov = np.array(two.covariance.matrix)
    std = np.sqrt(np.diag(cov))
    change = so3.log(one.rotation @ np.swapaxes(two.rotation, 1, 2)).ravel() / std
    e = so3.log(of.truth.rotation @ np.swapaxes(two.rotation, 1, 2)).ravel()
    e1 = so3.log(of.truth.rotation @ np.swapaxes(one.rotation, 1, 2)).ravel()
    clock = two.clocks[0]
    delay = 0.005 if scenario == "motion" else 0.0
    return {
        "seed": seed,
        "how": how,
        "status": two.status,
        "status one": one.status,
        "change": float(np.abs(change).max()),
        "offset": (clock.offset - how.offset - delay) / clock.offset_std,
        "offset std": clock.offset_std,
        "rate": (clock.rate - how.rate) / clock.rate_std,
        "z": e / std,
        "z one": e1 / np.sqrt(np.diag(np.array(one.covariance.matrix))),
        "d2": float(e @ np.linalg.solve(cov, e)) / len(e),
        "cost": found["two s"] / found["one s"],
    }


def table(results: list[dict[str, Any]]) -> str:
    good = [r for r in results if "failed" not in r]
    z = np.concatenate([r["z"] for r in good])
    z1 = np.concatenate([r["z one"] for r in good])
    within = [abs(r["offset"]) <= 3.0 for r in good]
    cells: list[object] = [
        len(results),
        f"{sum(r['status'] == 'accepted' for r in good)} "
        f"({sum(r['status one'] == 'accepted' for r in good)})",
        f"{np.median([r['change'] for r in good]):.3f}, {max(r['change'] for r in good):.2f}",
        f"{100 * np.mean(within):.0f} %",
        f"{1e3 * np.median([r['offset std'] for r in good]):.1f}",
        f"{100 * np.mean([abs(r['rate']) <= 3.0 for r in good]):.0f} %",
        f"{np.sqrt(np.mean(z**2)):.2f} ({np.sqrt(np.mean(z1**2)):.2f})",
        f"{np.mean([r['d2'] for r in good]):.2f}",
        f"{100 * np.mean(np.abs(z) <= 1.96):.1f} %",
        f"{np.median([r['cost'] for r in good]):.2f}",
    ]
    return row(*cells)


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
    with tempfile.TemporaryDirectory() as place:
        write_apart(Path(place), of.rig, moves, replace(loads, force=force))
        try:
            found = calibrate([Path(place)], trials=0)
        except TdfscalError as error:
            return f"exit {error.exit_status}"
    return "accepted" if found.accepted else "rejected"


def cost(seed: int) -> tuple[float, float]:
    """Processor time of one file with all samples, and of two recorders' files, s."""
    from tdfscal.files.writers.campaign import write_run

    of = played("self", seed, 250.0, 60)
    assert of.campaign is not None
    with tempfile.TemporaryDirectory() as place:
        folders = Path(place) / "one", Path(place) / "two"
        write_run(of, folders[0], format="csv")
        write_apart(
            folders[1],
            of.rig,
            *recorded_apart(of.campaign.log, Apart(3.7, 20e-6), np.random.default_rng(seed)),
        )
        spent = []
        for folder in folders:
            begin = time.process_time()
            calibrate([folder], trials=0)
            spent.append(time.process_time() - begin)
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
        results = over(partial(campaign, scenario=scenario), seeds)
        for r in results:
            plain: FloatArray | Any = {k: v for k, v in r.items() if k not in ("z", "z one")}
            print(plain)
        print(f"{HEAD}\n{table(results)}")
    elif given.what == "wrong":
        print(heads("pair", "runs", "outcome"))
        for what in ("other campaign", "swapped columns", "reversed time"):
            ends = over(partial(wrong, what=what), seeds)
            told = ", ".join(f"{ends.count(end)} {end}" for end in sorted(set(ends)))
            print(row(what, len(ends), told))
    else:
        print(heads("run", "one file, s", "two recorders, s", "ratio"))
        for seed in seeds:
            one, two = cost(seed)
            print(row(seed, f"{one:.2f}", f"{two:.2f}", f"{two / one:.2f}"))


if __name__ == "__main__":
    main()
