"""`tdfscal apply` against reading the same log: time, and peak memory.

Run: python benchmarks/apply.py > benchmarks/apply.md
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tdfscal.files.calibration.document import save_calibration
from tdfscal.files.writers.campaign import LogFormat, simulate_to_folder
from tdfscal.files.writers.wrenches import write_wrenches
from tdfscal.logs import iter_log
from tdfscal.simulation import Recorder
from tdfscal.workflows.calibrate import calibrate
from tdfscal.workflows.calibration_in_use import InUse, take
from tdfscal.wrench.contact_wrench import at_rest
from tdfscal.wrench.resampling import Tally, aligned

FORMATS: tuple[LogFormat, ...] = ("csv", "mcap", "parquet")
RECORDER = Recorder(dwell=(8.0, 10.0), move=(4.0, 6.0), force_rate=1000.0, position_rate=1000.0)
POSTURES = 24
HOUR = 3.6e6


def read(use: InUse) -> int:
    """Samples in the log, only read."""
    loaded = use.campaign.rig
    pieces = iter_log(use.campaign.logs, loaded.log, loaded.rig.supports)
    return sum(piece.force[0].time.size for piece in pieces)


def apply(use: InUse, target: Path | None) -> int:
    """The contact wrench of every sample, written or not."""
    loaded = use.campaign.rig
    pieces = iter_log(use.campaign.logs, loaded.log, loaded.rig.supports)
    found = at_rest(use.given, aligned(pieces, Tally()))
    if target is None:
        return sum(piece.time.size for piece in found)
    return write_wrenches(target, found, {})


def timed(work: Callable[[], int]) -> tuple[float, int]:
    """Shortest of three runs in s of processor time, and the samples."""
    best, count = float("inf"), 0
    for _ in range(3):
        start = time.process_time()
        count = work()
        best = min(best, time.process_time() - start)
    return best, count


def main() -> None:
    """Print the table."""
    print(
        "# Applying a calibration\n\n"
        "Made by `python benchmarks/apply.py`. Three supports, force and position at 1 kHz, a "
        "third of the\ntime in motion; processor time, best of three. Read: the log alone. Wrench: "
        "what contact wrenches\nwith their standard uncertainties cost on top. Written: that, and "
        "writing them to Parquet. The hour is\nscaled from the rows.\n"
    )
    print("| log | rows | read s | wrench s | written s | wrench / read | hour read + applied s |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        for form in FORMATS:
            folder, calibration = home / form, home / "calibration.yaml"
            simulate_to_folder(folder, format=form, postures=POSTURES, recorder=RECORDER, seed=1)
            if form == FORMATS[0]:
                save_calibration(calibrate([folder], trials=0), calibration)
            use = take(calibration, [folder])
            t_read, rows = timed(partial(read, use))
            t_apply, _ = timed(partial(apply, use, None))
            t_write, _ = timed(partial(apply, use, home / "w.parquet"))
            print(
                f"| {form} | {rows:,} | {t_read:.2f} | {t_apply - t_read:.2f} | "
                f"{t_write - t_read:.2f} | {(t_apply - t_read) / t_read:.2f} | "
                f"{t_write * HOUR / rows:.0f} |",
                flush=True,
            )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\nPeak memory of the whole run, the simulation of the logs included: {peak:.0f} MB.")


if __name__ == "__main__":
    main()
