"""What each part buys, of the search for dwells and of the self-calibration's tests.

    python -m benchmarks.ablation [--seeds 3] [--campaigns 12] [--only WORDS] [--kinds WORDS]

Rewrites `benchmarks/ablation.md`. A part is left out by putting a neutral function in its place
while the search runs; the product has no switch for it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.ablation_checks import HEADS as CHECK_HEADS
from benchmarks.ablation_checks import check_table
from benchmarks.dwell_stops import FAULTS, KINDS, Score, scored, together
from tdfscal.dwells import (
    DwellOptions,
    change_points,
    dwell_means,
    field,
    find,
    noise_level,
    noise_spectrum,
    search,
    settling,
)
from tdfscal.records import FloatArray

EVERY = (*KINDS, *FAULTS)
HEADS = ("left out", "logs", "stops", "found", "without", "in parts, astray", "without",
         "worst bias", "without", "z", "without", "time")  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A part of the search. where : kinds of logs that it is there for.

    put : (module, name, function in its place).
    """

    where: tuple[str, ...]
    put: tuple[tuple[Any, str, Any], ...]


def _kinds(*words: str) -> tuple[str, ...]:
    return tuple(kind for kind in EVERY if any(word in kind for word in words))


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _zeros(value: Any, *_: Any) -> Any:
    return np.zeros(len(value))


def _none_noisier(found: Any, moving: Any) -> Any:
    none = np.empty(0, dtype=np.int64)
    return noise_level.NoisierStops(none, none, np.ones((0, len(found.value))))


def _white(found: Any, stream: int, pooled: Any, length: Any, campaign: float) -> Any:
    return np.broadcast_to(np.diag(pooled), (len(length), 3, 3))


def _every_calm(of: Any, begin: int, end: int) -> list[tuple[int, int]]:
    first, last = noise_level.runs(~of.disturbed[begin:end])
    return [(begin + int(a), begin + int(b)) for a, b in zip(first, last, strict=True)]


def _plain_spread(size: Any, quantum: float) -> float:
    return float(1.4826 * np.median(size))


def _own_drift(value: Any, std: Any) -> Any:
    return np.ones(value.shape[1:])


def _one_round(bins: Any, options: Any = None) -> Any:
    of = field.prepare(bins, options or DwellOptions())
    extents, left_out = search.search(of, of.rate, of.long_run)
    return find._with_statistics(of, extents, left_out)


def _two_rounds(bins: Any, options: Any = None) -> Any:
    of = field.prepare(bins, options or DwellOptions())
    extents, left_out = search.search(of, of.rate, of.long_run, rough=True, some=60)
    rate, long_run = of.rate, of.long_run
    if extents:
        of = field.within(of, extents)
        moments = dwell_means.dwell_moments(bins, extents)
        rate = find._common_drift(of, extents, moments)
        found = find._long_run(bins, moments)
        long_run = np.where(found > 0, found, of.long_run)
    extents, left_out = search.search(of, rate, long_run)
    return find._with_statistics(of, extents, left_out)


SETTLE = _kinds("settling", "ringing")
PARTS: dict[str, Part] = {
    "first and second round": Part(_kinds("settling", "ringing", "drift", "correlated"),
        ((find, "dwells_of_bins", _one_round),)),
    "second round": Part(_kinds("settling", "ringing", "drift", "correlated"),
        ((find, "dwells_of_bins", _two_rounds),)),
    "rough first round": Part(SETTLE, ((find, "search",
        lambda *a, rough=False, **k: search.search(*a, **k)),)),
    "windows of many lengths (1 and 2 bins)": Part(_kinds("squeezes", "settling", "0.5 s"),
        ((noise_level, "SCALES", 2), (change_points, "SCALES", 2))),
    "seed of rest": Part(EVERY, ((change_points, "quiet_seed", lambda found, base, width: base),)),
    "log that never rests": Part(_kinds("never"), ((change_points, "travels",
        lambda noise: False),)),
    "creep is not noise": Part(SETTLE, ((change_points, "without_creep", lambda noise: noise),
        (field, "without_creep", lambda noise: noise))),
    "stops of their own noise": Part(_kinds("noisy"), ((field, "noisier_stops", _none_noisier),)),
    "noise of readings coarser than it": Part(_kinds("rounded", "written"),
        ((noise_level, "_spread", _plain_spread),)),
    "drift of all stops, before the search": Part(_kinds("drift"),
        ((field, "drift_of_rests", lambda value, *_: np.zeros(len(value))),)),
    "drift of all dwells, between rounds": Part(_kinds("drift"),
        ((find, "common_drift", lambda slope, span: np.zeros(slope.shape[1])),)),
    "ringing of all stops": Part(SETTLE, ((field, "find_ringing", _nothing),)),
    "cut at the ends until they fit": Part(SETTLE, ((settling, "_misfits",
        lambda *_: (0, 0)),)),
    "extrapolated decay": Part(SETTLE, ((settling, "_fit_decay", _nothing),)),
    "crests": Part(SETTLE, ((search, "_calm", _every_calm),)),
    "kept clear of moves": Part(_kinds("50 Hz", "5 kHz", "squeezes", "0.5 s"),
        ((search, "_kept_clear", lambda field, begin, *_, **__: np.zeros_like(begin)),)),
    "one bin more about a move": Part(_kinds("50 Hz", "5 kHz", "squeezes", "0.5 s"),
        ((field, "_dilated", lambda flag: flag),)),
    "parts of one stop joined": Part(_kinds("rounded", "written", "miscount"),
        ((search, "_whole_stops", lambda field, stretch, found: (found, [])),)),
    "unsettled dwells left out at the end": Part(SETTLE, ((find, "_drifts",
        lambda *_: ({}, [])),)),
    "vibration allowed for in lines and bows": Part(_kinds("vibration"),
        ((find, "_beyond_noise", _own_drift),)),
    "spectrum of the noise (white)": Part(_kinds("correlated", "vibration"),
        ((dwell_means, "density", _white),)),
    "autoregression in the spectrum": Part(_kinds("correlated"), ((noise_spectrum,
        "_rational_spectrum", lambda cov, f: np.broadcast_to(cov[0], (len(f), 3))),)),
    "noise slower than a stop": Part(_kinds("correlated", "AR", "1/f"), ((noise_spectrum,
        "slow_noise", lambda frequency, power, *_: [None] * len(power)),)),
    "own scatter of a noisy dwell": Part(_kinds("noisy"), ((dwell_means, "_excess_scatter",
        lambda scatter, count: np.ones_like(scatter)),)),
    "rounding in the covariance": Part(_kinds("rounded", "written"),
        ((dwell_means, "_rounding", lambda scatter, quantum: np.zeros_like(scatter)),)),
    "clock offset": Part((), ((find, "motion_offset", _nothing),)),
}  # fmt: skip


def _measured(part: Part, seeds: int, kinds: Iterable[str]) -> dict[str, tuple[Score, float]]:
    """Score and time per kind with a part left out."""
    measured = {}
    with ExitStack() as stack:
        for module, name, function in part.put:
            stack.enter_context(patch.object(module, name, function))
        for kind in kinds:
            start = time.process_time()
            measured[kind] = scored(kind, range(seeds)), time.process_time() - start
    return measured


def _row(name: str, logs: str, whole: list[Score], without: list[Score]) -> str:
    a, b = together(whole), together(without)

    def pair(show: Callable[[Score], str]) -> str:
        return f"{show(a)} | {show(b)}" if show(a) != show(b) else f"{show(a)} | ="

    def rms(value: FloatArray) -> str:
        return f"{np.sqrt((value**2).mean()):.2f}" if value.size else "–"

    cells = (
        pair(lambda score: f"{score.found}"),
        pair(lambda score: f"{score.parts}, {score.astray}"),
        pair(lambda score: f"{score.bias.max():.2f}" if score.bias.size else "–"),
        pair(lambda score: rms(score.z)),
    )
    return f"| {name} | {logs} | {a.stops} | {' | '.join(cells)} |"


def dwell_table(seeds: int, wanted: Callable[[str], bool], kinds: Sequence[str]) -> list[str]:
    """Rows of the table of the dwell search, on logs of these kinds."""
    whole = _measured(Part(EVERY, ()), seeds, kinds)
    spent = sum(seconds for _, seconds in whole.values())
    rows = []
    for name, part in PARTS.items():
        if not wanted(name):
            continue
        here = _measured(part, seeds, kinds)
        share = sum(seconds for _, seconds in here.values()) / spent
        there = tuple(kind for kind in kinds if kind in part.where)
        other = tuple(kind for kind in kinds if kind not in part.where)
        for logs, some in (("with", there), ("other", other)):
            if some:
                scores = [[of[kind][0] for kind in some] for of in (whole, here)]
                rows.append(f"{_row(name, logs, *scores)} {share:.2f} |")
                print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description="what each part buys")
    parser.add_argument("--seeds", type=int, default=3, help="logs of each kind")
    parser.add_argument("--campaigns", type=int, default=12, help="of each fault")
    parser.add_argument("--only", default="", help="parts of the search with these words, no file")
    parser.add_argument("--kinds", default="", help="logs of kinds with these words, no file")
    options = parser.parse_args()
    kinds = [kind for kind in EVERY if options.kinds in kind]
    rows = dwell_table(options.seeds, lambda name: options.only in name, kinds)
    if options.only or options.kinds:
        return
    checks = check_table(options.campaigns)
    text = _TEXT.format(
        seeds=options.seeds,
        campaigns=options.campaigns,
        rows="\n".join(rows),
        checks="\n".join(checks),
        check_heads=f"| {' | '.join(CHECK_HEADS)} |\n|{'---|' * len(CHECK_HEADS)}",
        heads=f"| {' | '.join(HEADS)} |\n|{'---|' * len(HEADS)}",
    )
    Path(__file__).with_suffix(".md").write_text(text, encoding="utf-8")


_TEXT = """# What each part buys

Made by `python -m benchmarks.ablation --seeds {seeds} --campaigns {campaigns}`. A part is left out
by putting a neutral function in its place while the benchmark runs.

## The search for dwells

{seeds} logs of each kind of `benchmarks/dwell_stops.py`. Rows "with" are the logs with what the
part is there for, "other" all the rest. Second columns: without the part, "=" for the same. In
parts, astray: stops found as more than one dwell, dwells that reach into a move. Bias: what is left
of settling in a mean force, over the stated standard error, the worst of all. z: (mean force −
truth) / standard error, rms. Time: of the search without the part over that with it (of one run,
± 0.2).

{heads}
{rows}

Parts that were left out for good, for no stop of any kind changed without them: levels that wander
below the threshold of a change, levels that lie on the decay of the next, and a second way to join
what a burst of force parts.

## Screenings and tests of the self-calibration

Reference rig, 24 postures, squeeze 100 N, {campaigns} campaigns of each fault. Of these: accepted
by the gate; accepted without a warning or a rejected posture; accepted although an angle moves by
more than twice its standard uncertainty.

{check_heads}
{checks}
"""


if __name__ == "__main__":
    main()
