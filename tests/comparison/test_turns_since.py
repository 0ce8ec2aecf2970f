"""Turns of which the filter is not told: against generalised least squares of the whole history."""

import numpy as np
import pytest

from tdfscal.comparison.control_chart import Kind, begin
from tdfscal.numerics.information import Information

SENSORS, SIZE, CHECKS, ROWS = 2, 8, 7, 9
TURNS = 3 * SENSORS


@pytest.mark.parametrize(("kind", "onset", "sensor"), [("step", 3, 0), ("creep", 2, 1)])
def test_a_turn_is_that_of_generalised_least_squares(kind: Kind, onset: int, sensor: int) -> None:
    """Irregular dates, a declared walk, constants that one check alone does not determine."""
    rng = np.random.default_rng(4)
    months = np.cumsum(rng.uniform(0.1, 3.0, CHECKS))
    gaps = np.diff(months, prepend=months[0])
    prior = Information(np.diag(rng.uniform(0.5, 2.0, SIZE)), np.zeros(SIZE))
    walk = np.where(np.arange(SIZE) < TURNS, 0.04, 0.0) * gaps[:, None]
    J = rng.standard_normal((CHECKS, ROWS, SIZE))
    J[2, :, :2] = 0.0
    y = rng.standard_normal((CHECKS, ROWS)) * 3
    own = [Information(j.T @ j, j.T @ r) for j, r in zip(J, y, strict=True)]

    now = begin(prior, own[0], SENSORS)
    for k in range(1, CHECKS):
        now = now.then(own[k], walk[k], gaps[k])
    seen = now.of(kind, sensor, onset)

    # All readings at once: y = J_k x_k + noise, x_k a walk from the prior, and the turn's columns.
    until = np.minimum.outer(np.arange(CHECKS), np.arange(CHECKS))
    spread = np.cumsum(walk, axis=0)[until] + 1 / np.diagonal(prior.matrix)
    V = np.einsum("kac,klc,lbc->kalb", J, spread, J).reshape(CHECKS * ROWS, -1)
    V += np.eye(CHECKS * ROWS)
    since = np.maximum(months - months[onset - 1], 0.0)
    shape = since if kind == "creep" else (since > 0) * 1.0
    where = slice(3 * sensor, 3 * sensor + 3)
    columns = (J[:, :, where] * shape[:, None, None]).reshape(-1, 3)
    weighted = np.linalg.solve(V, columns)
    np.testing.assert_allclose(seen.matrix, columns.T @ weighted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(seen.score, weighted.T @ y.ravel(), rtol=1e-9, atol=1e-9)
