"""Sound histories by every command that knows of months: false alarms, and contradictions.

A rig that nothing happens to is calibrated each month, tared anew. The months are calibrated one by
one, brought up to date one after the other, pooled, compared with their neighbours and monitored;
each verdict is the command's own.

    python -m benchmarks.histories [HISTORIES [FIRST]]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import tdfscal
from benchmarks.frame import heads, numbers, row, scratch
from tdfscal.files.writers.campaign import write_campaign
from tdfscal.records import Acceptance
from tdfscal.significance import ALARMS_PER_YEAR, INCOMPATIBLE
from tdfscal.simulation import Options, Recorder, make_rig
from tdfscal.simulation.scenarios import simulate_months

#: N/m, of the carriages; months and postures of a history; N, of the internal forces.
STIFFNESS, MONTHS, POSTURES, SQUEEZE = (20e6, 200e6), (4, 36), (6, 24), (100.0, 200.0, 400.0)
HEAD = heads("history", "sensors", "postures", "N/µm", "squeeze N", "months", "alone", "update",
             "pool", "compare", "monitor")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Verdicts:
    """What the commands say of one history.

    alone : months that `calibrate` rejects by themselves; the others go on. updates, compared :
    verdicts that something changed, per step from month to month. pooled : of all together.
    alarms : of the chart, by the step with which they were raised.
    """

    what: tuple[object, ...]
    alone: int
    updates: tuple[bool, ...]
    pooled: bool
    compared: tuple[bool, ...]
    alarms: tuple[int, ...]

    @property
    def contradicts(self) -> bool:
        """Whether some of update, pool and monitor say that the rig changed, and others not."""
        return len({any(self.updates), self.pooled, bool(self.alarms)}) > 1

    def __str__(self) -> str:
        counts = sum(self.updates), int(self.pooled), sum(self.compared), len(self.alarms)
        return row(*self.what, self.alone, *counts)


def written(seed: int, folder: Path) -> tuple[tuple[object, ...], list[Path]]:
    """Simulate a history of posture rows; return what it is, and its campaign folders."""
    rng = np.random.default_rng([seed, 28])
    sensors = int(rng.choice([3, 3, 4]))
    rig = replace(make_rig(sensors), acceptance=Acceptance(angle_std=0.05))
    months = round(float(np.exp(rng.uniform(*np.log(MONTHS)))))
    options = Options(
        postures=int(rng.integers(POSTURES[0], POSTURES[1] + 1)),
        squeeze=float(rng.choice(SQUEEZE)),
        stiffness=float(np.exp(rng.uniform(*np.log(STIFFNESS)))),
        rows="postures",
        recorder=Recorder(mean_sd=0.0),  # the noise that the rig file states, and no more
    )
    played = simulate_months(rig, options, rng, months, unchanged=True)
    places = [folder / date[:7] for date in played.dates]
    for campaign, place in zip(played.campaigns, places, strict=True):
        write_campaign(campaign, place, format="csv")
    stiff = 1e-6 * float(options.stiffness)
    how = f"{stiff:.0f}", f"{options.squeeze:g}", months
    return (seed, sensors, options.postures, *how), places


def judged(seed: int) -> Verdicts:
    """Go through a history by all commands."""
    with scratch() as folder:
        what, places = written(seed, folder)
        each = [tdfscal.calibrate(place, trials=0) for place in places]
        sound = [(own, place) for own, place in zip(each, places, strict=True) if own.accepted]
        alone = [own for own, _ in sound]
        last, updates = alone[0], list[bool]()
        for own, place in sound[1:]:
            new = tdfscal.update(last, place, trials=0)
            updates.append(not new.accepted)
            last = new if new.accepted else own
        pooled = tdfscal.calibrate([place for _, place in sound], trials=0)
        compared = [tdfscal.compare(a, b).exit_status != 0 for a, b in pairwise(alone)]
        alarms = tdfscal.monitor(*alone).alarms
    return Verdicts(
        what=what,
        alone=len(each) - len(sound),
        updates=tuple(updates),
        pooled=not pooled.accepted,
        compared=tuple(compared),
        alarms=tuple(alarm.raised for alarm in alarms),
    )


def summary(found: Sequence[Verdicts]) -> str:
    """Each verdict against its stated rate, and what contradicts."""
    steps = sum(len(each.updates) for each in found)
    stated = ALARMS_PER_YEAR * steps / 12
    rows = (
        ("update", sum(sum(each.updates) for each in found), f"{steps} months", stated),
        ("pool", sum(each.pooled for each in found), f"{len(found)} pools", stated),
        ("monitor", sum(len(each.alarms) for each in found), f"{steps} checks", stated),
        ("compare", sum(sum(e.compared) for e in found), f"{steps} pairs", INCOMPATIBLE * steps),
    )
    lines = [row(name, many, wrong, f"{most:.2f}") for name, wrong, many, most in rows]
    against = sum(each.contradicts for each in found)
    return "\n".join(
        [
            "\n" + heads("verdict", "of", "that something changed", "stated"),
            *lines,
            f"\nHistories in which update, pool and monitor contradict one another: {against} of "
            f"{len(found)}.",
        ]
    )


def main() -> None:
    """Print the tables."""
    histories, first = numbers(40, 0)
    print(HEAD, flush=True)
    found = []
    for seed in range(first, first + histories):
        found.append(judged(seed))
        print(found[-1], flush=True)
    print(summary(found))


if __name__ == "__main__":
    main()
