"""Simulated campaigns, calibrated by the product's own estimators, on several cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, TypeVar

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.records import Rig
from tdfscal.simulation import SurveyOptions, Truth, simulate_survey
from tdfscal.trackercal import TrackerCalibration, calibrate_tracker

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_T = TypeVar("_T")


def attempted(calibrate: Callable[[int], _T], runs: int) -> list[_T | None]:
    """What `calibrate` makes of each run; None where a calibration has no result."""
    found: list[_T | None] = []
    for run in range(runs):
        try:
            found.append(calibrate(run))
        except TdfscalError:
            found.append(None)
    return found


def by_tracker(
    rig: Rig, truth: Truth, survey: SurveyOptions, rng: np.random.Generator
) -> TrackerCalibration:
    """Survey one machine and calibrate it. Raises TdfscalError without result."""
    session = simulate_survey(rig, truth, survey, rng).session
    return calibrate_tracker(rig, session, misalignment=survey.body_misalignment, trials=0)


@contextmanager
def pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Processes of one thread each for linear algebra: together they use all cores.

    The libraries read these variables when they are loaded, so only new processes heed them.
    """
    added = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        with ProcessPoolExecutor(processes, get_context("spawn")) as workers:
            yield workers
    finally:
        for name in added:
            os.environ.pop(name, None)


def mapped(function: Callable[..., _T], *arguments: Iterable[Any], workers: int) -> Iterator[_T]:
    """`map`, here or in so many processes."""
    if workers == 1:
        yield from map(function, *arguments)
        return
    with pool(workers) as processes:
        yield from processes.map(function, *arguments)
