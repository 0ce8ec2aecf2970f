"""Machines without errors, and a statistic."""

from dataclasses import replace

import numpy as np
from scipy.special import gammaincc

from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
from tdfscal.simulation import Options, Recorder, make_rig

SILENT = Recorder(
    force_sd=(0.0, 0.0), encoder_sd=0.0, vibration=0.0, settling_force=0.0, mean_sd=0.0
)


def exact_rig(n: int = 3) -> Rig:
    """Every quantity known exactly, NCPs that repeat exactly, no force noise."""
    rig = make_rig(
        n, mass_std=0.0, barycentre_std=0.0, zero_std=0.0, declared=DeclaredUncertainty()
    )
    return replace(rig, rpy_std=np.zeros((n, 3)))


def loose_rig() -> Rig:
    """Every quantity uncertain, some unknown, every scatter declared."""
    rig = make_rig(
        declared=DeclaredUncertainty(
            positioner=1.0e-5,
            hinge=2.0e-5,
            datum=5.0e-5,
            force_noise=0.1,
            force_sensitivity=0.004,
            hinge_moment=0.05,
        )
    )
    return replace(
        rig,
        gravity_tilt_std=5.0e-4,
        barycentre=UncertainValue(np.array([0.01, -0.02, 0.25]), np.array([1e-3, 2e-3, 0.0])),
        nominal_rpy=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5708], [0.1, 0.0, -2.0]]),
    )


def still(**changes: object) -> Options:
    """Options of a silent recorder."""
    return replace(Options(recorder=SILENT), **changes)  # type: ignore[arg-type]


def chi2_p(standardised: FloatArray, dof: int | None = None) -> float:
    """Probability of a larger Σx² of independent standard normal x; dof where they are not."""
    dof = standardised.size if dof is None else dof
    return float(gammaincc(dof / 2, np.sum(standardised**2) / 2))


def plausible(p: float) -> bool:
    """Neither too large nor too small a scatter, at one in 500."""
    return 0.001 < p < 0.999
