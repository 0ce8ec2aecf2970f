"""Simulated campaigns and their verdict against the truth, shared by the tests of this folder."""

from dataclasses import dataclass

import numpy as np

from tdfscal import simulation
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.simulation import Options

SQUEEZED = Options(squeeze=100.0)


def fitted(rig: Rig, dwells: Dwells) -> SelfCalibration:
    """The self-calibration without Monte Carlo."""
    return self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)


def calibrated(batch: simulation.Batch, rig: Rig, trial: int) -> SelfCalibration:
    """One campaign of a batch, without Monte Carlo."""
    return fitted(rig, batch.dwells(trial))


def turns(truth: FloatArray, estimate: FloatArray) -> FloatArray:
    """Error d (3n,) with R_true = exp([d]×) R, rad."""
    return so3.log(truth @ np.swapaxes(estimate, -1, -2)).ravel()


def distance(truth: FloatArray, result: SelfCalibration) -> float:
    """d² of the errors of all turns in the stated covariance."""
    d = turns(truth, result.fit.state.rotation)
    return float(d @ np.linalg.solve(result.uncertainty.covariance, d))


@dataclass(frozen=True)
class Study:
    """Errors (N, 3n) of N campaigns, their stated standard uncertainties, and d² (N,)."""

    error: FloatArray
    stated: FloatArray
    distance: FloatArray
    results: tuple[SelfCalibration, ...]


def study(rig: Rig, options: Options, seed: int, trials: int) -> Study:
    """Calibrate `trials` independent campaigns of a rig."""
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), trials)
    errors, stated, distances, results = [], [], [], []
    for i in range(trials):
        result = calibrated(batch, rig, i)
        errors.append(turns(batch.truth.rotation[i], result.fit.state.rotation))
        stated.append(np.sqrt(np.diagonal(result.uncertainty.covariance)))
        distances.append(distance(batch.truth.rotation[i], result))
        results.append(result)
    return Study(np.array(errors), np.array(stated), np.array(distances), tuple(results))
