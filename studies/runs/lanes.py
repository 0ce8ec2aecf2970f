"""Lanes of a control simulation spread over processes, run by run; their number changes nothing."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from studies.control.loop import simulate
from studies.control.reference import Reference
from studies.control.runs import Controller, Docking, Machines, Result, Traces
from studies.control.servo import PositionErrors, draw_errors
from studies.runs.compared_calibrations import Arms
from studies.runs.ratios import Ratio, ratio
from studies.runs.simulated_campaigns import pool
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.simulation import Pose, Truth

#: Lane steps below which a second process costs more than it saves, and lanes per block at least.
#: The blocks go by the work alone, so that the number of processes changes no number.
_WORTH, _BLOCK = 1_000_000, 200
_A = TypeVar("_A", FloatArray, BoolArray)
_R = TypeVar("_R", Truth, PositionErrors, Pose)


@dataclass(frozen=True, slots=True)
class ControlStudy(ABC):
    """C calibrations on the same N machines. seed : as the user gave it."""

    arms: Arms
    seed: int
    result: Result

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the calibrations."""
        return self.arms.names

    def grid(self, values: _A) -> _A:
        """Values of the lanes (L, …) as (C, N, …) of calibrations and runs."""
        return values.reshape(len(self.names), -1, *values.shape[1:])

    @abstractmethod
    def sample(self, quantity: int) -> FloatArray:
        """(C, N): what is compared with the paper, by its place among the study's quantities; NaN
        of runs that did not come so far.
        """

    def values(self, name: str, quantity: int) -> FloatArray:
        """The same of one calibration (n,), of the runs that have it."""
        own = self.sample(quantity)[self.names.index(name)]
        return np.asarray(own[np.isfinite(own)])

    def ratio(self, quantity: int, of: str, to: str) -> Ratio:
        """Ratio of means with its standard error, over the runs that both have."""
        a, b = self.sample(quantity)[[self.names.index(of), self.names.index(to)]]
        both = np.isfinite(a) & np.isfinite(b)
        return ratio(a[both], b[both])


def simulate_lanes(
    rig: Rig,
    controller: Controller,
    arms: Arms,
    reference: Reference,
    seeds: Sequence[np.random.SeedSequence],
    docking: Docking | None = None,
    *,
    workers: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Result:
    """Go the way of every run with every calibration; lane = calibration · runs + run.

    reference : ways of all runs; of more than there are machines, which then go several. seeds : of
    the positions' errors and of the noise, which are the same for all calibrations.

    Raises as `loop.simulate`.
    """
    runs, copies = len(reference.start.translation), len(arms.arms)
    rng = np.random.default_rng(seeds[0])
    errors = draw_errors(controller.servo, rig.declared.positioner, runs, rig.n, rng)
    noise = seeds[1].spawn(runs)

    def task(part: IntArray) -> tuple[Machines, Controller, Reference, Docking | None]:
        run, machine = np.tile(part, copies), part % arms.runs
        assumed = [_taken(arm.assumed, machine) for arm in arms.arms]
        machines = Machines(
            rig,
            _taken(arms.truth, run % arms.runs),
            _taken(errors, run),
            Truth(*(np.concatenate(each) for each in zip(*map(_values, assumed), strict=True))),
            np.repeat([arm.tared for arm in arms.arms], len(part)),
            tuple(noise[i] for i in part),
        )
        start, goal = _taken(reference.start, run), _taken(reference.goal, run)
        return machines, controller, replace(reference, start=start, goal=goal), docking

    worth = copies * runs * len(reference.share) >= _WORTH
    blocks = min(runs, max(2, copies * runs // _BLOCK)) if worth else 1
    parts = np.array_split(np.arange(runs), blocks)
    first, *others = map(task, parts)
    if workers == 1 or blocks == 1:
        results = [simulate(*first, progress), *(simulate(*other) for other in others)]
    else:
        with pool(min(workers, blocks) - 1) as processes:
            waiting = [processes.submit(simulate, *other) for other in others]
            results = [simulate(*first, progress), *(one.result() for one in waiting)]
    lanes = np.arange(copies * runs).reshape(copies, runs)
    return _joined(results, np.argsort(np.concatenate([lanes[:, part].ravel() for part in parts])))


def _values(record: Any) -> tuple[Any, ...]:
    return tuple(getattr(record, f.name) for f in fields(record))


def _taken(record: _R, lanes: IntArray) -> _R:
    """These lanes of a record of arrays, which lie in memory alike whatever is taken."""
    return type(record)(*(np.take(value, lanes, axis=0) for value in _values(record)))


def _joined(results: list[Result], order: IntArray) -> Result:
    """Results of blocks as one, lanes in their order; the last record stands for what follows."""
    longest = max((r.traces.time for r in results), key=len)

    def together(parts: list[Any], axis: int) -> Any:
        whole = np.concatenate(parts, axis=axis)
        return whole if whole.shape[axis] == 0 else np.take(whole, order, axis=axis)

    def full(trace: Any) -> Any:
        missing = len(longest) - len(trace)
        return np.concatenate([trace, np.repeat(trace[-1:], missing, axis=0)])

    traces = [
        together(list(map(full, part)), 1)
        for part in zip(*(_values(r.traces)[1:] for r in results), strict=True)
    ]
    values = {
        f.name: together([getattr(r, f.name) for r in results], 0)
        for f in fields(Result)
        if f.name != "traces"
    }
    return Result(traces=Traces(longest, *traces), **values)
