"""Default runs over weak rigs, and what their trials cost.

    python -m benchmarks.monte_carlo [RUNS] > benchmarks/monte_carlo.md

Internal forces of 10 to 50 N against noise of 1 N, 12 to 60 postures, Monte Carlo as by default.
Broken: any error that is no verdict, or a number that is not finite. Cost: seconds of CPU of the
calibration with the trials over those without, the least of five each.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from itertools import cycle, islice, product

import numpy as np

from tdfscal import simulation
from tdfscal.errors import TdfscalError
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Options, Recorder

CELLS = tuple(product((10.0, 20.0, 50.0), (12, 24, 60)))


def finite(result: SelfCalibration) -> bool:
    """Every number of the trials is one."""
    trials = result.monte_carlo
    assert trials is not None
    numbers = (trials.mean, trials.std, trials.low, trials.high)
    return all(bool(np.isfinite(each).all()) for each in numbers)


def weak(seed: int, force: float, count: int) -> str:
    """Confirmed, replaced by the trials' intervals, refused (exit 1 to 4), or broken."""
    rig, rng = simulation.reference_rig(), np.random.default_rng(seed)
    options = Options(internal=force, postures=count, recorder=Recorder(mean_sd=1.0))
    batch = simulation.simulate_dwells(rig, options, rng, 1)
    try:
        result = self_calibrate(rig, batch.dwells(0), rng=rng)
    except TdfscalError:
        return "no verdict but a refusal"
    except Exception:
        return "broken"
    if not finite(result):
        return "broken"
    assert result.monte_carlo is not None
    lost = ", some trials unsettled" if result.monte_carlo.unsettled else ""
    return ("confirmed" if result.monte_carlo.validated else "the trials' intervals") + lost


def cost(postures: int) -> tuple[float, float]:
    """Seconds of CPU without and with the trials."""
    rig = simulation.reference_rig()
    options = Options(squeeze=100.0, postures=postures)
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(0), 1)
    found: dict[int | None, list[float]] = {0: [], None: []}
    for _ in range(5):
        for trials, seconds in found.items():
            start = time.process_time()
            self_calibrate(rig, batch.dwells(0), rng=np.random.default_rng(0), max_trials=trials)
            seconds.append(time.process_time() - start)
    return min(found[0]), min(found[None])


def main() -> None:
    """Print both tables."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    print("# Monte Carlo\n")
    print("| postures | without, s | with trials, s | ratio |\n|---|---|---|---|", flush=True)
    for postures in (30, 3000):
        without, whole = cost(postures)
        print(f"| {postures} | {without:.2f} | {whole:.2f} | {whole / without:.2f} |", flush=True)
    found = Counter(weak(seed, *cell) for seed, cell in enumerate(islice(cycle(CELLS), runs)))
    print(f"\n`python -m benchmarks.monte_carlo {runs}`: default runs over weak rigs.\n")
    print("| outcome | runs |\n|---|---|")
    for name in sorted(found):
        print(f"| {name} | {found[name]} |")


if __name__ == "__main__":
    main()
