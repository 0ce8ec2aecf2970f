"""Whole campaigns, simulated by forward physics and calibrated by the product's own estimators."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.covariance import evaluate, information_root
from tdfscal.selfcal.initial_guess import LinearData, linear_data, linear_rotations
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.simulation import Options, SurveyOptions, Truth, simulate_dwells, simulate_survey
from tdfscal.simulation.postures import draw_postures
from tdfscal.trackercal import calibrate_tracker

#: Campaigns that are simulated together; the seeds go by blocks, so that the number of processes
#: changes no number.
BLOCK = 25
#: Campaigns per block whose stated uncertainty is worked out; it hardly varies between them.
_STATED = 2

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

METHODS = ("ml", "linear", "tracker")


@dataclass(frozen=True, slots=True)
class Task:
    """One block of campaigns. options.command holds the postures, the same in every campaign."""

    rig: Rig
    options: Options
    survey: SurveyOptions
    methods: tuple[str, ...]
    size: int
    seed: np.random.SeedSequence


@dataclass(frozen=True, slots=True)
class Errors:
    """Estimate minus truth of one method.

    value : (B, n, 3), rad, roll, pitch, yaw in (−π, π]; NaN where a campaign has no result.
    stated : (S, n, 3), rad, standard uncertainties that the method itself states; S may be 0.
    """

    value: FloatArray
    stated: FloatArray


def commanded(rig: Rig, options: Options, rng: np.random.Generator) -> Options:
    """Draw the postures once for all campaigns of a study, as in Sect. 4."""
    command = draw_postures(rig, options, rng, 1).target(rig.hinge)[0]
    return replace(options, command=command)


def run_blocks(
    tasks: list[Task], workers: int, progress: Callable[[int], None]
) -> Iterator[dict[str, Errors]]:
    """Run the blocks in their order, here or in several processes; progress hears the runs done."""
    done = 0
    if workers <= 1 or len(tasks) == 1:
        for task in tasks:
            yield run_block(task)
            done += task.size
            progress(done)
        return
    processes = min(workers, len(tasks))
    with one_thread_each(), ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for task, result in zip(tasks, pool.map(run_block, tasks), strict=True):
            yield result
            done += task.size
            progress(done)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that start now use one thread for linear algebra: together they use all cores.

    The libraries read these variables when they are loaded, so only new processes heed them.
    """
    added = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def run_block(task: Task) -> dict[str, Errors]:
    """Simulate and calibrate one block of campaigns; method → errors."""
    rig = task.rig
    dwell_rng, survey_rng = (np.random.default_rng(s) for s in task.seed.spawn(2))
    batch = simulate_dwells(rig, task.options, dwell_rng, task.size)
    campaigns = [batch.dwells(i) for i in range(task.size)]
    out: dict[str, Errors] = {}
    if "ml" in task.methods:
        out["ml"] = _self(rig, campaigns, batch.truth)
    if "linear" in task.methods:
        out["linear"] = _linear(rig, campaigns, batch.truth)
    if "tracker" in task.methods:
        out["tracker"] = _tracker(task, batch.truth, survey_rng)
    return out


def _errors(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Angles of rotations (..., n, 3, 3) less the true ones (..., n, 3), in (−π, π]."""
    return so3.wrapped(so3.to_rpy(estimate) - truth)


def _self(rig: Rig, campaigns: list[Dwells], truth: Truth) -> Errors:
    errors = np.full((len(campaigns), rig.n, 3), np.nan)
    stated: list[FloatArray] = []
    for i, dwells in enumerate(campaigns):
        try:
            fit = fit_robust(rig, postures(rig, dwells)).fit
        except TdfscalError:
            continue
        errors[i] = _errors(fit.state.rotation, truth.rpy[i])
        if len(stated) < _STATED:
            stated.append(evaluate(fit, information_root(fit), 1.0).rpy_std)
    return Errors(errors, np.reshape(stated, (-1, rig.n, 3)))


def _linear(rig: Rig, campaigns: list[Dwells], truth: Truth) -> Errors:
    each = [linear_data(rig, postures(rig, dwells)) for dwells in campaigns]
    data = LinearData(
        load=np.stack([d.load for d in each]),
        pose=np.stack([d.pose for d in each]),
        weight=np.stack([d.weight for d in each]),
        moment=np.stack([d.moment for d in each]),
        hinge=rig.hinge,
        barycentre=rig.barycentre.value,
    )
    return Errors(_errors(linear_rotations(data), truth.rpy), np.empty((0, rig.n, 3)))


def _tracker(task: Task, truth: Truth, rng: np.random.Generator) -> Errors:
    rig, survey = task.rig, task.survey
    errors = np.full((task.size, rig.n, 3), np.nan)
    stated = []
    for i in range(task.size):
        one = truth.trial(i)
        session = simulate_survey(rig, one, survey, rng).session
        try:
            found = calibrate_tracker(rig, session, misalignment=survey.body_misalignment, trials=0)
        except TdfscalError:
            continue
        errors[i] = _errors(found.rotations.rotation, one.rpy)
        stated.append(found.rpy_std)
    return Errors(errors, np.reshape(stated, (-1, rig.n, 3)))
