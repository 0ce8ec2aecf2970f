"""False alarms of all tests of the self-calibration together, over sound campaigns of five kinds.

python -m benchmarks.supports_alarms [CAMPAIGNS PER KIND [SEED]] >> benchmarks/supports_alarms.md
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal import simulation
from tdfscal.records import Drift, Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, Recorder

_RECORDER = Recorder(mean_sd=0.1)


def kinds() -> Iterator[tuple[str, Rig, Options]]:
    """Sound campaigns: name, rig as stated and as it is, what is driven."""
    rig, axes = simulation.make_rig(3), np.ones((3, 3), dtype=np.bool_)
    axes[2, 1] = False
    squeezed = Options(squeeze=200.0, recorder=_RECORDER)
    internal = Options(internal=200.0, recorder=_RECORDER)
    yield "squeezed", rig, squeezed
    yield "internal forces by chance", rig, internal
    yield "a dead channel", replace(rig, axes=axes), internal
    yield "slopes declared", replace(rig, drift=Drift(time=np.inf)), squeezed
    yield "four supports, 30 postures", simulation.make_rig(4), replace(squeezed, postures=30)


def row(name: str, rig: Rig, options: Options, campaigns: int, seed: int) -> str:
    """One line: how many campaigns raise what."""
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), campaigns)
    suspected: Counter[str] = Counter()
    lost = rejected = 0
    for trial in range(campaigns):
        found = self_calibrate(rig, batch.dwells(trial), rng=np.random.default_rng(0), max_trials=0)
        suspected.update(doubt.kind for doubt in found.suspicions[:1])
        lost += bool(found.rejected)
        rejected += bool(found.reasons)
    words = ", ".join(f"{kind} {count}" for kind, count in suspected.most_common()) or "–"
    total = sum(suspected.values())
    return f"| {name} | {seed} | {campaigns} | {total} | {words} | {rejected} | {lost} |"


def main() -> None:
    """Print the rows."""
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    for name, rig, options in kinds():
        print(row(name, rig, options, campaigns, seed), flush=True)


if __name__ == "__main__":
    main()
