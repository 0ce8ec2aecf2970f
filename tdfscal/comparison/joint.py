"""Self-calibration and laser tracker together: are they consistent, and what do both say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.comparison.compatibility import Comparison, compare_pair, in_order_of, rpy_std
from tdfscal.errors import NotConvergedError
from tdfscal.findings import Finding
from tdfscal.numerics import so3
from tdfscal.numerics.information import inverse
from tdfscal.numerics.least_squares import block_diagonal, gauss_newton
from tdfscal.records import FloatArray, Rotations


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
    informations = [inverse(each.covariance) for each in (self_calibration, second)]
    covariance = inverse(informations[0] + informations[1])
    n = len(self_calibration.supports)
    roots = [np.linalg.cholesky(each).T for each in informations]
    estimates = (self_calibration.rotation, second.rotation)

    def rows(X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """W_a d_a of both, and their slopes by left turns of X."""
        away = [so3.log(X @ np.swapaxes(rotation, 1, 2)) for rotation in estimates]
        slopes = [block_diagonal(*np.linalg.inv(so3.left_jacobian(d))) for d in away]
        return (
            np.concatenate([W @ d.ravel() for W, d in zip(roots, away, strict=True)]),
            np.concatenate([W @ J for W, J in zip(roots, slopes, strict=True)]),
        )

    def turned(X: FloatArray, step: FloatArray) -> FloatArray:
        return so3.exp(step.reshape(n, 3)) @ X

    # The difference, shared out by the informations, is all but the answer.
    start = covariance @ informations[0] @ test.rotation_vector.ravel()
    found = gauss_newton(rows, turned, turned(second.rotation, start))
    if not found.converged:
        raise NotConvergedError(Finding("joint-unsettled"))
    X = found.state
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
