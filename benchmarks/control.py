"""Simulated seconds per second of the control studies.

Run: python -m benchmarks.control > benchmarks/control.md
"""

from __future__ import annotations

import time

import numpy as np

from tdfscal.simulation import reference_rig
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import simulated


def main() -> None:
    """Print the table."""
    print(
        "# Control studies\n\n"
        "Made by `python -m benchmarks.control`. Reference rig, three calibrations, step 4 ms,\n"
        "as `tdfscal study` runs them, without tables and figures. Processor seconds of one core;\n"
        "lane seconds are simulated seconds times runs times calibrations (and moves).\n"
    )
    print("| study | runs | lanes | simulated s | processor s | simulated s / s | lane s / s |")
    print("|---|---|---|---|---|---|---|")
    rig = reference_rig()
    for runs in (1, 10):
        start = time.process_time()
        arms = simulated(rig, runs, np.random.default_rng(0))
        print(
            f"| campaigns and calibrations | {runs} | | | {time.process_time() - start:.1f} | | |"
        )
        seed = np.random.SeedSequence(1)
        start = time.process_time()
        free = free_space.free_space(free_space.Setup(rig), arms, seed, 1)
        _row("free space", runs, 18 * runs, free.result.steps * 4e-3, time.process_time() - start)
        start = time.process_time()
        dock = docking.docking(docking.Setup(rig), arms, seed, 1)
        _row("docking", runs, 3 * runs, dock.result.steps * 4e-3, time.process_time() - start)


def _row(name: str, runs: int, lanes: int, simulated_s: float, passed: float) -> None:
    print(
        f"| {name} | {runs} | {lanes} | {simulated_s:.0f} | {passed:.1f} | "
        f"{simulated_s / passed:.1f} | {lanes * simulated_s / passed:.0f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
