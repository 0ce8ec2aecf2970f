"""Self-calibration and laser tracker together: are they consistent, and what do both say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.comparison.compatibility import Comparison, compare_pair, in_order_of, rpy_std
from tdfscal.errors import NotConvergedError
from tdfscal.numerics import so3
from tdfscal.numerics.information import inverse
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import FloatArray, Rotations

_MAX_ITERATIONS = 30


@dataclass(frozen=True, slots=True)
class Joint:
    """The joint estimate of two calibrations of the same sensors.

    test : the consistency test that comes first; its verdict gates the result: rotations of an
    inconsistent pair describe neither. weight : (n, 3), share of the second estimate (the tracker)
    in each component of d in the BCS, 0 … 1 where uncorrelated.
    """

    rotations: Rotations
    rpy: FloatArray
    rpy_std: FloatArray
    test: Comparison
    weight: FloatArray


def combine(self_calibration: Rotations, tracker: Rotations) -> Joint:
    """Weight two independent estimates by their full covariances on SO(3)ⁿ.

    Minimises Σ d_aᵀ C_a⁻¹ d_a over X, with d_a stacked from log(X_i X_{a,i}ᵀ), by Gauss–Newton.
    The covariance is (C_1⁻¹ + C_2⁻¹)⁻¹, which in no direction exceeds either C_a; turning the
    covariances from X_a to X would change it by about |d_a|/2 of itself, mrad here.

    Raises
    ------
    DataError : the two are not of the same supports.
    NotConvergedError : no minimum was found, which only estimates far apart can cause.
    """
    test = compare_pair(("self", self_calibration), ("tracker", tracker))
    second = in_order_of(self_calibration, tracker)
    covariances = (self_calibration.covariance, second.covariance)
    informations = [inverse(c) for c in covariances]
    covariance = inverse(informations[0] + informations[1])
    n = len(self_calibration.supports)
    start = test.rotation_vector.reshape(-1)  # of self against tracker
    X = so3.exp((covariance @ informations[0] @ start).reshape(n, 3)) @ second.rotation
    estimates = (self_calibration.rotation, second.rotation)
    for _ in range(_MAX_ITERATIONS):
        H, gradient = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
        for rotation, information in zip(estimates, informations, strict=True):
            d = so3.log(X @ np.swapaxes(rotation, 1, 2))
            J = block_diagonal(*np.linalg.inv(so3.left_jacobian(d)))
            H += J.T @ information @ J
            gradient += J.T @ information @ d.reshape(-1)
        step = np.linalg.solve(H, -gradient)
        X = so3.exp(step.reshape(n, 3)) @ X
        if -gradient @ step < 1e-16:
            break
    else:
        raise NotConvergedError(
            "the joint estimate found no minimum",
            hint="compare the two calibrations; they lie too far apart to be combined",
        )
    X = so3.project(X)
    rotations = Rotations(self_calibration.supports, X, covariance)
    share = np.diag(covariance @ informations[1]).reshape(n, 3)
    return Joint(
        rotations=rotations,
        rpy=so3.to_rpy(X),
        rpy_std=rpy_std(rotations),
        test=test,
        weight=share,
    )
