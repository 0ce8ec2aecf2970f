"""What each part buys, of the search for dwells and of the self-calibration's tests.

    python -m benchmarks.ablation [--seeds 3] [--campaigns 12] [--only WORDS]

Rewrites `benchmarks/ablation.md`; with `--campaigns 0` the second table stays as it is. A part is
left out by putting a neutral function in its place while the search runs; the product has no switch
for it.
"""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.ablation_checks import HEADS as CHECK_HEADS
from benchmarks.ablation_checks import check_table
from benchmarks.dwell_stops import FAULTS, KINDS, SLOW, Score, recorded_of, score, together
from tdfscal.dwells import (
    Bins,
    change_points,
    dwell_means,
    dwells_of_bins,
    field,
    find,
    noise_level,
    noise_spectrum,
    reduce_to_bins,
    ringing,
    search,
    settling,
)
from tests.dwells.rig_log import Recorded

HEADS = ("left out", "time", "logs that change", "found", "in parts, astray", "bias, worst",
         "z, rms")  # fmt: skip
Replaced = tuple[Any, str, Any]


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _none_noisier(found: Any, moving: Any) -> Any:
    none = np.empty(0, dtype=np.int64)
    return noise_level.NoisierStops(none, none, np.ones((0, len(found.value))))


def _every_calm(of: Any, begin: int, end: int) -> list[tuple[int, int]]:
    first, last = noise_level.runs(~of.disturbed[begin:end])
    return [(begin + int(a), begin + int(b)) for a, b in zip(first, last, strict=True)]


def _independent(of: Any, length: Any, whole: Any) -> Any:
    return of.of_mean(length) ** 2 + of.of_mean(whole) ** 2


PARTS: dict[str, tuple[Replaced, ...]] = {
    "looks before the search": ((find, "search", lambda of, *a, rough=False, some=None:
        ([], []) if some else search.search(of, *a)),),
    "the first look is rough": ((find, "search", lambda *a, rough=False, **k:
        search.search(*a, **k)),),
    "windows of many lengths (1 and 2 bins)": (
        (noise_level, "SCALES", 2), (change_points, "SCALES", 2)),
    "marks and noise in turn (once)": ((change_points, "_ROUNDS", 1),),
    "seed of rest": ((change_points, "quiet_seed", lambda found, base, width: base),),
    "log that never rests": ((change_points, "travels", lambda noise: False),),
    "creep is not noise": ((change_points, "without_creep", lambda noise: noise),
        (field, "without_creep", lambda noise: noise)),
    "stops of their own noise": ((field, "noisier_stops", _none_noisier),),
    "noise of readings coarser than it": ((noise_level, "_spread",
        lambda size, quantum: float(1.4826 * np.median(size))),),
    "drift of all stops, before the search": ((field, "drift_of_rests",
        lambda value, *_: np.zeros(len(value))),),
    "drift of all dwells": ((find, "common_drift", lambda slope, span: np.zeros(slope.shape[1])),),
    "ringing of all stops": ((field, "find_ringing", _nothing),),
    "ringing in slow noise": ((ringing, "_memory", lambda *_: []),),
    "what ringing may leave": ((ringing.Ringing, "left", lambda of, rest, start, end:
        np.zeros((len(start), of.power.shape[1]))),),
    "cut at the ends until they fit": ((settling, "_misfits", lambda *_: (0, 0)),),
    "ends judged by autocorrelation": ((noise_level.Noise, "of_part", _independent),),
    "extrapolated decay": ((settling, "_fit_decay", _nothing),),
    "crests": ((search, "_calm", _every_calm),),
    "kept clear of moves": ((search, "_kept_clear",
        lambda field, begin, *_, **__: np.zeros_like(begin)),),
    "one bin more about a move": ((field, "_dilated", lambda flag: flag),),
    "parts of one stop joined": ((search, "_whole_stops",
        lambda field, stretch, found: (found, [])),),
    "unsettled dwells left out at the end": ((find, "_drifts", lambda *_: ({}, [])),),
    "vibration allowed for in lines and bows": ((find, "_beyond_noise",
        lambda value, std: np.ones(value.shape[1:])),),
    "spectrum of the noise (white)": ((dwell_means, "density",
        lambda found, stream, pooled, length, campaign:
            np.broadcast_to(np.diag(pooled), (len(length), 3, 3))),),
    "autoregression in short stops": ((noise_spectrum, "_shape",
        lambda raw, length, frequency: np.ones((*raw.shape[1:], len(frequency)))),),
    "noise slower than a stop": ((noise_spectrum, "slow_noise",
        lambda frequency, power, length: [None] * len(power)),),
    "own scatter of a noisy dwell": ((dwell_means, "_excess_scatter",
        lambda scatter, count: np.ones_like(scatter)),),
    "rounding in the covariance": ((dwell_means, "_rounding",
        lambda scatter, quantum: np.zeros_like(scatter)),),
}  # fmt: skip

Logs = dict[str, list[tuple[Recorded, Bins]]]


def _measured(logs: Logs, put: tuple[Replaced, ...] = ()) -> tuple[dict[str, Score], float]:
    """Score of each kind with a part left out, and the time of the search, s of CPU."""
    with ExitStack() as stack:
        for module, name, function in put:
            stack.enter_context(patch.object(module, name, function))
        begin = time.process_time()
        found = {
            kind: together([score(recorded, dwells_of_bins(bins)) for recorded, bins in some])
            for kind, some in logs.items()
        }
        return found, time.process_time() - begin


def _cells(of: Score) -> list[str]:
    bias = f"{of.bias.max():.2f}" if of.bias.size else "–"
    z = f"{np.sqrt((of.z**2).mean()):.2f}" if of.z.size else "–"
    return [f"{of.found} of {of.stops}", f"{of.parts}, {of.astray}", bias, z]


def _changed(whole: Score, without: Score) -> bool:
    """By more than what one stop, or a tenth of the bias or of z, makes of it by chance."""
    if abs(whole.found - without.found) > 1 or whole.parts != without.parts:
        return True
    if whole.astray != without.astray or not (whole.z.size and without.z.size):
        return whole.astray != without.astray or whole.z.size != without.z.size
    worst = without.bias.max() - whole.bias.max()
    z = np.sqrt((without.z**2).mean() / (whole.z**2).mean())
    return bool(abs(worst) > 0.1 or abs(z - 1.0) > 0.1)


def dwell_table(seeds: int, wanted: str) -> list[str]:
    """Rows of the table of the dwell search: the kinds of logs that each part changes."""
    logs = {
        kind: [
            (replace(one, log=None), reduce_to_bins([one.log]))  # type: ignore[arg-type]
            for one in recorded_of(kind, range(seeds))
        ]
        for kind in (*KINDS, *FAULTS, *SLOW)
    }
    whole, spent = _measured(logs)
    rows = []
    for name, put in PARTS.items():
        if wanted not in name:
            continue
        without, took = _measured(logs, put)
        changed = [kind for kind in logs if _changed(whole[kind], without[kind])]
        for kind in changed or ["none"]:
            pairs = zip(_cells(whole[kind]), _cells(without[kind]), strict=True) if changed else ()
            cells = [a if a == b else f"{a} → {b}" for a, b in pairs] or [""] * 4
            rows.append(f"| {name} | {took / spent:.2f} | {kind} | {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description="what each part buys")
    parser.add_argument("--seeds", type=int, default=3, help="logs of each kind")
    parser.add_argument("--campaigns", type=int, default=12, help="of each fault")
    parser.add_argument("--only", default="", help="parts of the search with these words, no file")
    options = parser.parse_args()
    rows = dwell_table(options.seeds, options.only)
    if options.only:
        return
    path = Path(__file__).with_suffix(".md")
    _, mark, checks = path.read_text(encoding="utf-8").partition("## Screenings")
    checks = mark + checks
    if options.campaigns:
        table = [f"| {' | '.join(CHECK_HEADS)} |", f"|{'---|' * len(CHECK_HEADS)}"]
        table += check_table(options.campaigns)
        checks = _CHECKS.format(campaigns=options.campaigns, checks="\n".join(table))
    table = [f"| {' | '.join(HEADS)} |", f"|{'---|' * len(HEADS)}", *rows]
    text = _DWELLS.format(seeds=options.seeds, rows="\n".join(table))
    path.write_text(text + checks, encoding="utf-8")


_DWELLS = """# What each part buys

Made by `python -m benchmarks.ablation`. A part is left out by putting a neutral function in its
place while the benchmark runs.

## The search for dwells

`--seeds {seeds}`: logs of each kind of `benchmarks/dwell_stops.py`; with the part → without it, for
the kinds that change by more than one stop found, or by a tenth in bias or z. In parts, astray:
stops found as more than one dwell, dwells that reach into a move. Bias: what is left of settling in
a mean force, over the stated standard error, the worst of all. z: (mean force − truth) / standard
error, rms. Time: CPU of the search without the part over that with it, ± 0.1.

{rows}

Left out for good, for no stop of any kind changed without them: restless levels, levels on a decay,
a second way to join what a burst parts, further modes of ringing, an autoregression in the spectrum
of stops of 64 bins or more. Kept without a row: what makes the words of `info` and of "no static
dwell" (a log that never rests, the clocks' offset). Asked for by `tests/dwells` alone: looks before
the search (stops in noise slow as 1 s, filtered forces), the first of them rough (forces rounded to
five times their noise), the drift of all stops before it (0.5 N/s).

"""

_CHECKS = """## Screenings and tests of the self-calibration

Reference rig, 24 postures, squeeze 100 N, {campaigns} campaigns of each fault. Of these: accepted
by the gate; accepted without a warning or a rejected posture; accepted although an angle moves by
more than twice its standard uncertainty.

{checks}

Left out for good: starts of the mounting search by quarter turns of every sensor, and turned so
that its load points upwards. With 64 starts drawn evenly beside the nominal mounting and the linear
solution, 140 campaigns as in `mountings` and `minima` end as they did with some 200 starts; of 140
with 4 to 6 postures and three to nine sensors 130 are right (before, 129), in 0.8 of the time.
"""


if __name__ == "__main__":
    main()
