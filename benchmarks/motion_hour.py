"""An hour at 1 kHz: time of a calibration in motion over that of reading alone, and memory.

python -m benchmarks.motion_hour [--seconds 3600] [--format parquet]
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
from tdfscal.simulation import MOVING, reference_rig, run_moving


def write(folder: Path, seconds: float, form: str) -> None:
    """Simulate a long campaign in motion."""
    options = replace(MOVING["motion"], duration=seconds, rate=1000.0, noise=3.5)
    played = run_moving(reference_rig(), "motion", options, np.random.default_rng(0))
    write_run(played, folder, format=form, overwrite=True)  # type: ignore[arg-type]


def work(folder: Path, what: str) -> None:
    """Read alone, or calibrate; print seconds and the peak of the memory in MB."""
    began = time.perf_counter()
    if what == "read":
        loaded = load_rig(folder / "rig.yaml")
        log = next(p for p in folder.iterdir() if p.stem == "log")
        for _ in iter_log((log,), loaded.log, loaded.rig.supports):
            pass
    else:
        tdfscal.calibrate(folder, samples="moving")
    took = time.perf_counter() - began
    print(took, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


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
        figures = []
        for step in ("write", "read", "calibrate"):
            done = subprocess.run(
                [
                    sys.executable, "-m", "benchmarks.motion_hour", "--step", step,
                    "--folder", f"{place}/campaign", "--seconds", str(chosen.seconds),
                    "--format", chosen.format,
                ],
                capture_output=True, text=True, check=True,
            )  # fmt: skip
            figures += [float(word) for word in done.stdout.split()] if step != "write" else []
    read, read_mb, both, both_mb = figures
    print(
        f"| {chosen.format} | {chosen.seconds:.0f} | {read:.1f} | {both:.1f} | "
        f"{both / read:.2f} | {read_mb:.0f} | {both_mb:.0f} |"
    )


if __name__ == "__main__":
    main()
