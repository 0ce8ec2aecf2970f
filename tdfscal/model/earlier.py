"""What earlier campaigns know of a rig's constants, on its way into and out of the estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.model.parameters import State, constants, prior_std, retract, vector
from tdfscal.numerics.information import Information
from tdfscal.records import BoolArray, FloatArray, JointPrior, Rig

#: A sensor that was mounted anew turns by about this much, rad per axis. Postures are not called
#: outliers for a turn that all of them share.
REMOUNTED = 5e-3


def free_constants(rig: Rig) -> BoolArray:
    """Which parameters (P,) are constants of the rig and not exactly known."""
    return np.asarray(constants(rig.n) & (prior_std(rig) > 0))


def joint_prior(
    rig: Rig, reference: State, known: Information, chi2: float = 0.0, dof: int = 0
) -> JointPrior:
    """Gaussian of the free constants (C,) about a reference as the prior of a campaign's fit."""
    free = free_constants(rig)
    step = np.zeros(len(free))
    step[free] = known.mean
    estimate = retract(reference, step)
    root = np.zeros((int(free.sum()), len(free)))
    root[:, free] = np.linalg.cholesky(known.matrix).T
    return JointPrior(estimate.rotation, vector(estimate), root, chi2, dof)


def information_of(rig: Rig, prior: JointPrior) -> Information:
    """Information (C,) of a prior about its own estimate."""
    root = prior.root[:, free_constants(rig)]
    return Information(root.T @ root, np.zeros(root.shape[1]))


def turned(rig: Rig, std: float) -> FloatArray:
    """Variance (C,) of the free constants after every sensor turned by std, rad per axis."""
    variance = np.zeros(int(free_constants(rig).sum()))
    variance[: 3 * rig.n] = std**2
    return variance


def loosened(rig: Rig) -> Rig:
    """Return the rig with an earlier knowledge that allows for sensors mounted anew."""
    if rig.earlier is None:
        return rig
    wide = information_of(rig, rig.earlier).walked(turned(rig, REMOUNTED))
    root = np.zeros_like(rig.earlier.root)
    root[:, free_constants(rig)] = np.linalg.cholesky(wide.matrix).T
    return replace(rig, earlier=replace(rig.earlier, root=root))
