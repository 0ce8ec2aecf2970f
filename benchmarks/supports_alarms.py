"""False alarms of all tests of the self-calibration together, over sound campaigns of five kinds.

An alarm is whatever questions a campaign: a suspicion, a posture left out, noise above what is
stated (of all channels or of some), a rig that changed. Every kind and seed draws its own numbers.

python -m benchmarks.supports_alarms [CAMPAIGNS PER KIND [SEED [logs]]]

With `logs` the campaigns are recordings, whose dwells are searched, with slopes declared.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.frame import lacking, numbers, show, tally
from tdfscal import simulation
from tdfscal.dwells import find_dwells
from tdfscal.records import Drift, Dwells, Rig
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.significance import MISFIT
from tdfscal.simulation import Options, Recorder

_RECORDER = Recorder(mean_sd=0.1)


def kinds() -> Iterator[tuple[str, Rig, Options]]:
    """Sound campaigns: name, rig as stated and as it is, what is driven."""
    rig = simulation.make_rig(3)
    squeezed = Options(squeeze=200.0, recorder=_RECORDER)
    internal = Options(internal=200.0, recorder=_RECORDER)
    yield "squeezed", rig, squeezed
    yield "internal forces by chance", rig, internal
    yield "a dead channel", lacking(3, (2, 1)), internal
    yield "slopes declared", replace(rig, drift=Drift(time=np.inf)), squeezed
    yield "four supports, 30 postures", simulation.make_rig(4), replace(squeezed, postures=30)


def questions(found: SelfCalibration) -> set[str]:
    """What questions a campaign, by kind."""
    asked = {doubt.kind or "frame" for doubt in found.suspicions[:1]}
    if found.rejected:
        asked.add("lost posture")
    if found.quality.p_value < MISFIT:
        asked.add("misfit")
    return asked


def recordings(campaigns: int, seed: int) -> Iterator[Dwells]:
    """Dwells found in simulated logs."""
    rig, options = simulation.reference_rig(), Options(squeeze=100.0)
    for trial in range(campaigns):
        played = simulation.simulate_campaign(rig, options, np.random.default_rng([seed, trial]))
        yield find_dwells(played.log)


def line(seed: int, name: str, rig: Rig, dwells: Iterable[Dwells]) -> None:
    """Print how many campaigns raise what."""
    asked: Counter[str] = Counter()
    campaigns = alarms = rejected = 0
    for each in dwells:
        found = self_calibrate(rig, each, rng=np.random.default_rng(0), max_trials=0)
        own = questions(found)
        asked.update(own)
        campaigns += 1
        alarms += bool(own)
        rejected += bool(found.reasons)
    show(seed, name, campaigns, alarms, tally(asked) or "–", rejected)


def main() -> None:
    """Print the rows."""
    campaigns, seed = numbers(60, 1)
    if "logs" in sys.argv:
        rig = replace(simulation.reference_rig(), drift=Drift(time=np.inf))
        line(seed, "logs, slopes declared", rig, recordings(campaigns, seed))
        return
    for index, (name, rig, options) in enumerate(kinds()):
        rng = np.random.default_rng([seed, index])
        batch = simulation.simulate_dwells(rig, options, rng, campaigns)
        line(seed, name, rig, (batch.dwells(trial) for trial in range(campaigns)))


if __name__ == "__main__":
    main()
