"""Zeros that drift and follow the temperature while the terminal moves, files in and result out."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tdfscal.commands.calibrate import calibrate_samples
from tdfscal.commands.campaign import resolve
from tdfscal.commands.log_pass import LogPass, Settings
from tdfscal.files.writers.campaign import write_run
from tdfscal.model.parameters import layout
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Drift
from tdfscal.simulation import MOVING, reference_rig, run
from tdfscal.simulation.faults import Drift as Creep
from tdfscal.simulation.faults import Faults, Warming
from tests.motioncal.campaigns import distance

SLOPES = ((0.15, -0.1, 0.2), (0.0, 0.2, -0.15), (-0.1, 0.1, 0.1))


def test_zeros_follow_the_hall_and_the_hour(tmp_path: Path) -> None:
    """10 K and 3 N of creep in a minute; both are declared, and found within their uncertainty."""
    rig = replace(reference_rig(), drift=Drift(temperature=1.0, time=0.1))
    faults = Faults(warming=Warming(10.0, SLOPES), drifts=(Creep(2, (3.0, -2.0, 3.0)),))
    options = replace(MOVING["motion"], rate=100.0, faults=faults)
    played = run(rig, "motion", options, np.random.default_rng(5))
    write_run(played, tmp_path / "warm", format="mcap")
    log = LogPass(resolve(tmp_path / "warm"), Settings(trials=0))
    motion = calibrate_samples(log, None, "ml", np.random.default_rng(0))
    assert isinstance(motion, MotionCalibration)
    assert (motion.reasons, motion.suspicions) == ((), ())
    std = motion.uncertainty.parameter_std[layout(3, 2)["drift"]].reshape(2, 3, 3)
    found = motion.fit.state.still.drift
    true = np.zeros((2, 3, 3))
    true[0, 2] = np.array([3.0, -2.0, 3.0]) / options.duration
    true[1] = SLOPES
    assert np.all(std[1] < 0.5)
    assert np.all(np.abs(found - true) < 4 * std)
    assert played.moving is not None
    rotation, covariance = motion.fit.state.still.rotation, motion.uncertainty.covariance
    assert distance(played.moving, rotation, covariance) < chi2_quantile(1 - 1e-3, 9)
