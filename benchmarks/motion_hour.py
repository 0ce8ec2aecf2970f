"""An hour at 1 kHz: time of a calibration in motion over that of reading alone, and memory.

python -m benchmarks.motion_hour [--seconds 3600] [--format parquet]

Reading alone is tdfscal's own reading into checked pieces, and that of a plain reader of the
format (pyarrow, mcap), which checks nothing. Seconds of the processors, all threads together, and
of the clock; the imports, alike for all, come before.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import tdfscal
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.writers.campaign import write_run
from tdfscal.logs import iter_log
from tdfscal.simulation import MOVING, reference_rig, run


def write(folder: Path, seconds: float, form: str) -> None:
    """Simulate a long campaign in motion."""
    options = replace(MOVING["motion"], duration=seconds, rate=1000.0, noise=3.5)
    played = run(reference_rig(), "motion", options, np.random.default_rng(0))
    write_run(played, folder, format=form, overwrite=True)  # type: ignore[arg-type]


def work(folder: Path, what: str) -> None:
    """Read alone, or calibrate; print seconds and the peak of the memory in MB."""
    log = next(p for p in folder.iterdir() if p.stem == "log")
    tdfscal.calibrate  # noqa: B018 - imports what it needs
    loaded = load_rig(folder / "rig.yaml")
    began, used = time.perf_counter(), time.process_time()
    if what == "read":
        for _ in iter_log((log,), loaded.log, loaded.rig.supports):
            pass
    elif what == "plain":
        plain(log)
    else:
        tdfscal.calibrate(folder, samples="moving")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(time.process_time() - used, time.perf_counter() - began, peak)


def plain(log: Path) -> None:
    """Read every value by the format's own library, piece by piece."""
    if log.suffix == ".parquet":
        import pyarrow.parquet

        for batch in pyarrow.parquet.ParquetFile(log).iter_batches():
            batch.to_pandas()
    elif log.suffix == ".csv":
        import pyarrow.csv

        for batch in pyarrow.csv.open_csv(log):
            batch.to_pandas()
    else:
        from mcap.reader import make_reader

        with log.open("rb") as stream:
            for _ in make_reader(stream).iter_messages(log_time_order=False):
                pass


def main() -> None:
    """Print one row of the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--format", default="parquet")
    parser.add_argument("--step", default="")
    parser.add_argument("--folder", type=Path)
    chosen = parser.parse_args()
    if chosen.step:
        if chosen.step == "write":
            write(chosen.folder, chosen.seconds, chosen.format)
        else:
            work(chosen.folder, chosen.step)
        return
    with tempfile.TemporaryDirectory() as place:
        cells = []
        first = 0.0
        for step in ("write", "read", "plain", "calibrate"):
            done = subprocess.run(
                [
                    sys.executable, "-m", "benchmarks.motion_hour", "--step", step,
                    "--folder", f"{place}/campaign", "--seconds", str(chosen.seconds),
                    "--format", chosen.format,
                ],
                capture_output=True, text=True, check=True,
            )  # fmt: skip
            if step == "write":
                continue
            used, clock, peak = (float(word) for word in done.stdout.split())
            first = first or used
            cells += [f"{used:.1f} ({clock:.1f})", f"{peak:.0f}"]
    print(
        f"| {chosen.format} | {chosen.seconds:.0f} | {' | '.join(cells)} | {used / first:.2f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
