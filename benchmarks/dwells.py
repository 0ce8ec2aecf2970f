"""Dwells: what is found of known stops, and the time from samples to dwells.

    python -m benchmarks.dwells [--seeds 8]

Rewrites `benchmarks/dwells.md`.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from benchmarks.dwell_stops import HEADS, KINDS, SLOW, scored, together
from benchmarks.frame import heads, over, publish, row
from benchmarks.logs import NAMES, RATE, blocks
from tdfscal.dwells import find_dwells, reduce_to_bins
from tdfscal.records import Log, Series


def pieces(seconds: float) -> Iterator[Log]:
    """Three supports, one time column; the logs of `benchmarks.logs` in memory."""
    for t, value in blocks(seconds):
        split = [np.ascontiguousarray(value[:, 3 * i : 3 * i + 3]) for i in range(6)]
        series = tuple(Series(t, part) for part in split)
        yield Log(NAMES, series[:3], series[3:])


def timed(work: Callable[[], object]) -> float:
    """Shortest of two runs, s."""
    runs = []
    for _ in range(2):
        start = time.perf_counter()
        work()
        runs.append(time.perf_counter() - start)
    return min(runs)


def moments(logs: list[Log]) -> None:
    """Mean and standard deviation of each column of each piece."""
    for log in logs:
        for series in (*log.position, *log.force):
            for column in series.value.T:
                column.mean()
                column.std()


PAGE = """\
# Dwells

Made by `python -m benchmarks.dwells --seeds {seeds}`. Logs of known stops,
{seeds} of each kind, made by `tests/dwells/rig_log.py` with parameters drawn at
random from the ranges in `benchmarks/dwell_stops.py`. Bias: what settling leaves in
a mean force without its noise, over the stated standard error.

{found}

Noise that is alike over much of a stop, {slow_seeds} logs of 16 stops of each kind:

{slow}

1/f noise over eight logs moves the zeros of one log too, which is no posture's error
and stands in the last column.

## Speed

Three supports, 19 columns, 1 kHz, arrays in memory. Ratios are to numpy's mean and
standard deviation of the same columns.

{speed}

Dwells of the hour read as a stream: {streamed}. Peak memory of the whole run, \
with the hour's arrays held: {peak:.0f} MB.
"""


def main() -> None:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description="dwells: what is found, and how fast")
    parser.add_argument("--seeds", type=int, default=8, help="logs of each kind")
    seeds = parser.parse_args().seeds
    scores = dict(zip(KINDS, over(partial(scored, seeds=range(seeds)), KINDS), strict=True))
    found = [heads(*HEADS), *(one.row(what) for what, one in scores.items())]
    found.append(together(list(scores.values())).row("all"))
    slow = [heads(*HEADS), *(scored(what, range(5 * seeds)).row(what) for what in SLOW)]
    rows = [heads("minutes", "rows", "bins", "dwells", "mean, std s", "reduce s",
                  "reduce + find s", "ratio, reduce", "ratio, all")]  # fmt: skip
    for minutes in (10, 60):
        logs = list(pieces(60.0 * minutes))
        plain = timed(lambda logs=logs: moments(logs))  # type: ignore[misc]
        reduced = timed(lambda logs=logs: reduce_to_bins(logs))  # type: ignore[misc]
        whole = timed(lambda logs=logs: find_dwells(logs))  # type: ignore[misc]
        bins, count = len(reduce_to_bins(logs)), len(find_dwells(logs))
        cells = [minutes, f"{minutes * 60 * RATE:,}", f"{bins:,}", count]
        cells += [f"{value:.2f}" for value in (plain, reduced, whole)]
        rows.append(row(*cells, f"{reduced / plain:.1f}", f"{whole / plain:.1f}"))
        del logs
    streamed = len(find_dwells(pieces(3600.0)))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    tables = {"found": found, "slow": slow, "speed": rows}
    joined = {name: "\n".join(lines) for name, lines in tables.items()}
    page = PAGE.format(seeds=seeds, slow_seeds=5 * seeds, streamed=streamed, peak=peak, **joined)
    publish(__file__, page)


if __name__ == "__main__":
    main()
