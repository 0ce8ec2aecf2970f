"""Simulated campaigns whose last postures are held out from the calibration."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np

from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.simulation import Batch, Faults, Options, make_rig, simulate_dwells

USED = 24
HELD = 5
RIG = make_rig()


@dataclass(frozen=True)
class World:
    """Campaigns (trials) of USED + HELD dwells, and their calibrations from the first USED."""

    batch: Batch
    given: Sequence[Calibrated]

    def __len__(self) -> int:
        return len(self.given)

    def held(self, trial: int) -> Dwells:
        """The postures that the calibration has not seen."""
        return part(self.batch.dwells(trial), np.arange(USED, USED + HELD))


def part(dwells: Dwells, rows: FloatArray | np.typing.NDArray[np.int64]) -> Dwells:
    """Some of the dwells."""
    index = np.asarray(rows, dtype=np.int64)
    each = {f.name: getattr(dwells, f.name) for f in fields(Dwells)}
    whole = ("supports", "left_out", "findings", "force_range", "force_still")
    columns = {k: v[index] for k, v in each.items() if k not in whole and v is not None}
    return replace(dwells, **columns)


@cache
def simulated(
    trials: int, faults: Faults | None = None, mass: float = 500.0, seed: int = 1
) -> Batch:
    """Campaigns of the reference rig; with one seed, the same rigs, postures and noise."""
    options = Options(postures=USED + HELD, squeeze=200.0, faults=faults or Faults())
    return simulate_dwells(make_rig(mass=mass), options, np.random.default_rng(seed), trials)


@cache
def world(trials: int, seed: int = 1) -> World:
    """Campaigns, calibrated when their calibrations are asked for."""
    batch = simulated(trials, seed=seed)
    return World(batch, _Calibrations(batch, trials))


class _Calibrations(Sequence[Calibrated]):
    """Of campaigns of a batch, each made when it is asked for."""

    def __init__(self, batch: Batch, trials: int) -> None:
        self.batch, self.trials = batch, trials
        self.made: dict[int, Calibrated] = {}

    def __len__(self) -> int:
        return self.trials

    def __getitem__(self, trial: Any) -> Any:
        if not 0 <= trial < self.trials:
            raise IndexError(trial)
        if trial not in self.made:
            self.made[trial] = calibrate(RIG, self.batch.dwells(trial))
        return self.made[trial]


def calibrate(rig: Rig, dwells: Dwells) -> Calibrated:
    """Calibrate from the first USED dwells."""
    fit = best_start(rig, postures(rig, part(dwells, np.arange(USED))))
    return estimate(fit).calibrated


def turned(world: World, trial: int, sensor: int, turn: FloatArray) -> Dwells:
    """Held-out dwells after a sensor has turned by a vector in rad, BCS."""
    dwells, truth = world.held(trial), world.batch.truth
    X, z = truth.rotation[trial, sensor], truth.zero[trial, sensor]
    force = dwells.force.copy()
    # f' − z = X'ᵀ F = (exp([a]×) X)ᵀ X (f − z)
    force[:, sensor] = (force[:, sensor] - z) @ ((so3.exp(turn) @ X).T @ X).T + z
    return replace(dwells, force=force)
