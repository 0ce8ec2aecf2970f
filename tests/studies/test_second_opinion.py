"""The paper's methods once more, written from its equations alone, against those of the studies."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from studies.linear import by_angles, by_entries, readings
from tdfscal.model.statics import postures
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.linear_method import linear_data
from tdfscal.selfcal.linear_method import linear_rotations as products
from tdfscal.simulation import Batch, Options, reference_rig, simulate_dwells

RIG = reference_rig()


def hat(v: FloatArray) -> FloatArray:
    """Eq. 7."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=float)


def pose(hinge: FloatArray, measured: FloatArray) -> FloatArray:
    """R of Eq. 1 from three hinges, by scipy's solution of Wahba's problem."""
    a, b = hinge - hinge.mean(axis=0), measured - measured.mean(axis=0)
    found, _ = Rotation.align_vectors(b, a)
    return np.asarray(found.as_matrix())


def balance(
    rig: Rig, p: FloatArray, f: FloatArray, X: FloatArray, *, forces: bool
) -> list[FloatArray]:
    """Left less right side of Eq. 21, and of the force balance of Eq. 4, times the rms lever."""
    G = np.array([0.0, 0.0, -float(rig.mass.value) * 9.80665])
    R = pose(rig.hinge, p)
    moment = hat(rig.barycentre.value) @ R.T @ G
    force = G.copy()
    for i in range(rig.n):
        moment = moment + hat(rig.hinge[i]) @ R.T @ X[i] @ f[i]
        force = force + X[i] @ f[i]
    lever = np.sqrt(np.mean([r @ r for r in rig.hinge]))
    return [moment, lever * force] if forces else [moment]


def residuals(batch: Batch, run: int, X: FloatArray, *, forces: bool) -> FloatArray:
    return np.concatenate([
        part
        for p, f in zip(batch.means.position[run], batch.means.force[run], strict=True)
        for part in balance(RIG, p, f, X, forces=forces)
    ])  # fmt: skip


@pytest.fixture(scope="module")
def batch() -> Batch:
    return simulate_dwells(RIG, Options(squeeze=200.0), np.random.default_rng(4), 2)


@pytest.mark.parametrize("forces", [False, True])
def test_the_entries(batch: Batch, forces: bool) -> None:
    """27 unknowns: the balance is linear in them, so its columns are its values at unit entries."""
    given = readings(RIG, batch.means.position, batch.means.force)
    ours = by_entries(given, forces=forces)
    for run in range(2):
        none = residuals(batch, run, np.zeros((3, 3, 3)), forces=forces)
        columns = [
            residuals(batch, run, unit.reshape(3, 3, 3), forces=forces) - none
            for unit in np.eye(27)
        ]
        entries = np.linalg.lstsq(np.transpose(columns), -none, rcond=None)[0].reshape(3, 3, 3)
        for i in range(3):
            U, _, Vt = np.linalg.svd(entries[i])
            nearest = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
            np.testing.assert_allclose(ours[run, i], nearest, atol=1e-9)


@pytest.mark.parametrize("forces", [False, True])
def test_the_angles(batch: Batch, forces: bool) -> None:
    """9 unknowns, roll, pitch and yaw of Eq. 8, by scipy's least squares."""
    given = readings(RIG, batch.means.position, batch.means.force)
    start = np.broadcast_to(np.eye(3), (2, 3, 3, 3))
    ours = by_angles(given, start, forces=forces)

    def misfit(angles: FloatArray, run: int) -> FloatArray:
        X = Rotation.from_euler("xyz", angles.reshape(3, 3)).as_matrix()
        return residuals(batch, run, X, forces=forces)

    for run in range(2):
        found = least_squares(misfit, np.zeros(9), args=(run,), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        X = Rotation.from_euler("xyz", found.x.reshape(3, 3)).as_matrix()
        np.testing.assert_allclose(ours[run], X, atol=1e-7)


def test_the_product_has_the_same_linear_method(batch: Batch) -> None:
    ours = by_entries(readings(RIG, batch.means.position, batch.means.force))
    for run in range(2):
        theirs = products(linear_data(RIG, postures(RIG, batch.dwells(run))))
        np.testing.assert_allclose(ours[run], theirs, atol=1e-9)
