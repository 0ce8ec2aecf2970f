"""Lanes of a control simulation spread over processes, run by run; their number changes nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np

from tdfscal.records import IntArray, Rig
from tdfscal.simulation.control.loop import simulate
from tdfscal.simulation.control.reference import Reference
from tdfscal.simulation.control.runs import Controller, Docking, Machines, Result, Traces
from tdfscal.simulation.control.servo import Servo, draw_errors
from tdfscal.studies.compared_calibrations import Arms, tiled
from tdfscal.studies.simulated_campaigns import one_thread_each

#: Lane steps below which a second process costs more than it saves, and lanes per block at least.
#: The blocks go by the work alone, so that the number of processes changes no number.
_WORTH, _BLOCK = 1_000_000, 200
#: Axis of the lanes in what is recorded.
_SECOND = {"peak", "peak_length", "peak_measured", "phase_start"}


def simulate_lanes(
    machines: Machines,
    controller: Controller,
    reference: Reference,
    docking: Docking | None = None,
    *,
    workers: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Result:
    """As `loop.simulate`, on several cores. Raises what it raises."""
    lanes, runs = len(machines.tared), len(machines.noise)
    worth = lanes * len(reference.share) >= _WORTH
    blocks = min(runs, max(2, lanes // _BLOCK)) if worth else 1
    if blocks == 1:
        return simulate(machines, controller, reference, docking, progress)
    grid = np.arange(lanes).reshape(-1, runs)
    parts = np.array_split(np.arange(runs), blocks)
    tasks = [
        (
            replace(
                _some(machines, grid[:, part].ravel(), lanes),
                noise=tuple(machines.noise[i] for i in part),
            ),
            controller,
            _some(reference, grid[:, part].ravel(), lanes),
            _some(docking, grid[:, part].ravel(), lanes),
        )
        for part in parts
    ]
    if workers == 1:
        results = [simulate(*tasks[0], progress), *(simulate(*task) for task in tasks[1:])]
    else:
        processes = min(workers, blocks) - 1
        with one_thread_each(), ProcessPoolExecutor(processes, get_context("spawn")) as pool:
            others = [pool.submit(simulate, *task) for task in tasks[1:]]
            results = [simulate(*tasks[0], progress), *(other.result() for other in others)]
    order = np.argsort(np.concatenate([grid[:, part].ravel() for part in parts]))
    return _joined(results, order)


def machines_of(
    rig: Rig,
    servo: Servo,
    arms: Arms,
    seeds: Sequence[np.random.SeedSequence],
    copies: int = 1,
) -> Machines:
    """Machines of all lanes, (arm, copy, run); seeds : of their positions' errors and of noise.

    Errors and noise of a copy's run are the same for all arms.
    """
    error_seed, noise_seed = seeds
    count, rng = copies * arms.runs, np.random.default_rng(error_seed)
    errors = draw_errors(servo, rig.declared.positioner, count, rig.n, rng)
    truth, assumed, tared = arms.lanes(copies)
    noise = tuple(noise_seed.spawn(count))
    return Machines(rig, truth, tiled(errors, len(arms.arms)), assumed, tared, noise)


def _some(record: Any, index: IntArray, lanes: int) -> Any:
    """Some lanes of a record: of every array in it whose first axis are the lanes."""
    if isinstance(record, np.ndarray):
        return record[index] if record.shape[:1] == (lanes,) else record
    if is_dataclass(record) and not isinstance(record, type):
        values = {f.name: getattr(record, f.name) for f in fields(record)}
        kept = {n: v for n, v in values.items() if is_dataclass(v) or isinstance(v, np.ndarray)}
        return replace(record, **{n: _some(v, index, lanes) for n, v in kept.items()})
    return record


def _joined(results: list[Result], order: IntArray) -> Result:
    """Results of blocks as one, lanes in their order; the last record stands for what follows."""
    longest = max(results, key=lambda r: len(r.traces.time)).traces

    def together(parts: list[Any], axis: int) -> Any:
        whole = np.concatenate(parts, axis=axis)
        return whole if whole.shape[axis] == 0 else np.take(whole, order, axis=axis)

    def full(trace: Any) -> Any:
        missing = len(longest.time) - len(trace)
        return np.concatenate([trace, np.repeat(trace[-1:], missing, axis=0)])

    traces = {
        f.name: together([full(getattr(r.traces, f.name)) for r in results], 1)
        for f in fields(Traces)
        if f.name != "time"
    }
    values = {
        f.name: together([getattr(r, f.name) for r in results], int(f.name in _SECOND))
        for f in fields(Result)
        if f.name not in ("traces", "steps")
    }
    return Result(
        traces=Traces(time=longest.time, **traces), steps=max(r.steps for r in results), **values
    )
