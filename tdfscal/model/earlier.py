"""What earlier campaigns know of a rig's constants, on its way into and out of the estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.model.parameters import EVEN_TURN, State, constants, prior_std, retract, vector
from tdfscal.numerics.information import Information
from tdfscal.records import BoolArray, FloatArray, JointPrior, Rig

#: A sensor that was mounted anew turns by about this much, rad per axis. Postures are not called
#: outliers for a turn that all of them share.
REMOUNTED = 5e-3
#: A spin known no better than this, rad, is open: nothing linear holds along it.
_OPEN = 0.3
#: And is held within this, rad, while the others are sought.
_PIN = 1e-3


def free_constants(rig: Rig) -> BoolArray:
    """Which parameters (P,) are constants of the rig and not exactly known."""
    return np.asarray(constants(rig.n) & (prior_std(rig) > 0))


def joint_prior(
    rig: Rig, reference: State, known: Information, chi2: float = 0.0, dof: int = 0
) -> JointPrior:
    """Gaussian of the free constants (C,) about a reference as the prior of a campaign's fit.

    Estimates of a sensor that measures one axis have no common spin axis, and seem to say something
    of the spin: that is taken from them.
    """
    free = free_constants(rig)
    step = np.zeros(len(free))
    mean = known.mean
    for spin in _open_spins(rig, known, reference.rotation):
        mean -= spin * (spin @ mean)
    step[free] = mean
    estimate = retract(reference, step)
    matrix = known.matrix
    for spin in _open_spins(rig, known, estimate.rotation):
        seen = matrix @ spin
        matrix = matrix - np.outer(seen, seen) / (spin @ seen)
        matrix += np.outer(spin, spin) / EVEN_TURN**2
    root = np.zeros((int(free.sum()), len(free)))
    root[:, free] = np.linalg.cholesky(matrix).T
    return JointPrior(estimate.rotation, vector(estimate), root, chi2, dof)


def information_of(rig: Rig, prior: JointPrior) -> Information:
    """Information (C,) of a prior about its own estimate."""
    root = prior.root[:, free_constants(rig)]
    return Information(root.T @ root, np.zeros(root.shape[1]))


def _open_spins(rig: Rig, known: Information, rotation: FloatArray) -> FloatArray:
    """Directions (s, C) of the spins of sensors about the only axis that they measure, BCS.

    Those that nothing knows; rotation : (n, 3, 3), the estimate.
    """
    covariance, found = known.covariance, []
    for i in np.flatnonzero(rig.axes.sum(axis=1) == 1):
        direction = np.zeros(len(covariance))
        direction[3 * i : 3 * i + 3] = rotation[i][:, np.argmax(rig.axes[i])]
        if direction @ covariance @ direction > _OPEN**2:
            found.append(direction)
    return np.array(found).reshape(-1, len(covariance))


def pinned(rig: Rig) -> Rig:
    """Return the rig with an earlier knowledge that holds the spins which no posture shows.

    While the balance is linearised about a state, they seem to be shown and wander.
    """
    if rig.earlier is None or not np.any(rig.axes.sum(axis=1) == 1):
        return rig
    known = information_of(rig, rig.earlier)
    spins = _open_spins(rig, known, rig.earlier.rotation)
    return _with_matrix(rig, known.matrix + spins.T @ spins / _PIN**2)


def _with_matrix(rig: Rig, matrix: FloatArray) -> Rig:
    """Return the rig with another information (C, C) about the same earlier estimate."""
    assert rig.earlier is not None
    root = np.zeros_like(rig.earlier.root)
    root[:, free_constants(rig)] = np.linalg.cholesky(matrix).T
    return replace(rig, earlier=replace(rig.earlier, root=root))


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
    return _with_matrix(rig, wide.matrix)
