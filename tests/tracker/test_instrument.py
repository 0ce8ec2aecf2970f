"""Noise of a spherical instrument and of point files against draws and closed forms."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tdfscal.errors import DataError
from tdfscal.records import FloatArray, Instrument, PointSet
from tdfscal.simulation import measure
from tdfscal.trackercal.best_fit import register
from tdfscal.trackercal.judged_registration import fit_survey
from tdfscal.trackercal.noise import Noise, angle_covariance, observe, point_noise, range_covariance
from tdfscal.trackercal.point_matching import MatchedPoints

from .world import rotation

TRACKER = Instrument(range=1e-5, range_ppm=5.0, angle_arcsec=200.0)
PLACES = np.array([[3.0, -4.0, 2.0], [-1.0, 0.5, -6.0], [2.0, 1.0, 0.0], [0.0, 0.0, 4.0]])


def test_covariance_is_the_scatter_of_what_the_instrument_reads() -> None:
    """Drawn by a formula of its own, one direction after the other."""
    rng, draws = np.random.default_rng(0), 4000
    stated = range_covariance(PLACES, TRACKER) + angle_covariance(PLACES, TRACKER)
    seen = measure(np.repeat(PLACES[:3, None], draws, axis=1), TRACKER, rng)
    own = observe(PLACES[:3], TRACKER, rng, draws)
    assert own.shape == (draws, 3, 3)
    for k in range(3):
        L = np.linalg.cholesky(stated[k])
        for drawn in (seen[k], own[:, k]):
            white = np.linalg.solve(L, (drawn - PLACES[k]).T)
            assert np.abs(white @ white.T / draws - np.eye(3)).max() < 5 * np.sqrt(2 / draws)


def test_the_zenith_is_regular_and_the_instrument_itself_no_point() -> None:
    assert np.linalg.eigvalsh(angle_covariance(PLACES, TRACKER)[3])[1] > 0
    with pytest.raises(DataError):
        angle_covariance(np.zeros((1, 3)), TRACKER)


def matched(seed: int, groups: int = 1, noise: float = 1e-5) -> MatchedPoints:
    """Six points a group, all of one frame, with isotropic noise."""
    rng = np.random.default_rng(seed)
    count = 6 * groups
    x = rng.uniform(-0.5, 0.5, size=(count, 3))
    y = x @ rotation(rng).T + [3.0, 1.0, 2.0] + noise * rng.normal(size=x.shape)
    group = tuple(f"g{k // 6}" for k in range(count))
    point = tuple("ABCDEF"[k % 6] for k in range(count))
    measured, reference = (PointSet(group, point, xyz, None, "file.csv") for xyz in (y, x))
    return MatchedPoints(measured, reference, missing=(), extra=())


def but(points: MatchedPoints, **changed: Any) -> MatchedPoints:
    """The same points with fields such as `measured_xyz` replaced."""
    sides: dict[str, dict[str, Any]] = {"measured": {}, "reference": {}}
    for name, value in changed.items():
        side, field = name.split("_")
        sides[side][field] = value
    return replace(
        points, **{side: replace(getattr(points, side), **new) for side, new in sides.items()}
    )


def isotropic(std: float | FloatArray, count: int) -> FloatArray:
    return np.asarray(np.multiply.outer(np.ones(count) * np.asarray(std) ** 2, np.eye(3)))


def test_noise_is_the_instruments_unless_the_file_states_it() -> None:
    points = matched(1)
    C, D = point_noise(points, TRACKER, {"drawing": 3e-5, "nothing": 0.0}).totals(6)
    own = range_covariance(points.measured.xyz, TRACKER) + angle_covariance(
        points.measured.xyz, TRACKER
    )
    assert np.allclose(C, own, rtol=1e-12, atol=0)
    assert np.allclose(D, isotropic(3e-5, 6), rtol=1e-12, atol=0)
    stated = np.full((6, 3), np.nan)
    stated[2] = [1e-4, 2e-4, 3e-4]
    some = but(points, measured_std=stated, reference_std=2 * stated)
    C, D = point_noise(some, TRACKER, {"drawing": 3e-5}).totals(6)
    assert np.allclose(C[2], np.diag(stated[2] ** 2), rtol=1e-12, atol=0)
    assert np.allclose(D[2], 4 * np.diag(stated[2] ** 2), rtol=1e-12, atol=0)
    others = [0, 1, 3, 4, 5]
    assert np.allclose(C[others], own[others], rtol=1e-12, atol=0)
    assert np.allclose(D[others], isotropic(3e-5, 5), rtol=1e-12, atol=0)


def test_rounded_coordinates_are_uniform_within_their_last_digit() -> None:
    points = but(matched(3), measured_resolution=1e-4, reference_resolution=1e-3)
    digits = 1e-4 * np.round(np.random.default_rng(0).uniform(size=400_000) * 1e3 % 1, 9)
    spread = digits.std()
    C, D = point_noise(points, None, {"drawing": 1e-9}).totals(6)
    assert np.allclose(np.sqrt(C[0, 0, 0]), spread, rtol=5e-3, atol=0)
    assert np.allclose(D, isotropic(1e-9, 6), atol=0)  # a stated drawing covers how it is written
    stated = but(points, measured_std=np.full((6, 3), 1e-9))
    C, D = point_noise(stated, None, {}).totals(6)
    assert np.allclose(np.sqrt(C[0, 0, 0]), spread, rtol=5e-3, atol=0)
    assert np.allclose(np.sqrt(D[0, 0, 0]), 10 * spread, rtol=5e-3, atol=0)
    C, D = point_noise(points, None, {}).totals(6)  # nothing stated: the residuals show it
    assert not C.any()
    assert not D.any()


def test_an_uncertainty_of_zero_in_some_direction_is_refused() -> None:
    flat = np.tile(np.diag([1e-10, 1e-10, 0.0]), (6, 1, 1))
    with pytest.raises(DataError, match="zero in some direction"):
        fit_survey(matched(1), Noise({"x": flat}, {}), common_shift=True, least=3, what="points")


def of_files(points: MatchedPoints, std: float | None = None) -> tuple[PointSet, PointSet]:
    stated = None if std is None else np.full_like(points.measured.xyz, std)
    return replace(points.measured, std=stated), points.reference


def test_noise_of_the_residuals_counts_what_they_determined() -> None:
    """Σ|e|² over 3 N − 6 degrees of freedom."""
    measured, reference = of_files(matched(11))
    found = register(measured, replace(reference, xyz=0.9995 * reference.xyz))
    dof = 18 - 6
    assert found.dof == dof
    assert found.sigma == pytest.approx(np.sqrt(np.sum(found.residual**2) / dof), rel=1e-9)
    assert found.rms == pytest.approx(np.sqrt(np.sum(found.residual**2) / 6), rel=1e-12)
    assert (found.chi2, found.p_value) == (None, None)
    known = register(*of_files(matched(11), 1e-5))
    assert known.sigma is None
    assert known.p_value == pytest.approx(stats.chi2.sf(known.chi2, dof), rel=1e-9)
    assert known.dof == dof


def four(shape: FloatArray, off: FloatArray) -> MatchedPoints:
    """Four points of a shape, one of them off."""
    points = matched(14).take(np.arange(len(shape)))
    y = shape @ rotation(np.random.default_rng(14)).T + [3.0, 1.0, 2.0]
    y[1] += off
    return but(points, measured_xyz=y, reference_xyz=shape)


SQUARE = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 2


def test_of_four_points_one_may_be_left_out() -> None:
    """Of a lopsided tripod's feet and tip, but none of a square: there all look alike."""
    noise = Noise({"x": isotropic(1e-5, 4)}, {})
    lopsided = np.array([[0.5, 0.4, 0], [-0.6, 0.3, 0.1], [-0.1, -0.5, 0], [0.1, 0.2, 0.5]])
    found = register(*of_files(four(lopsided, np.array([1e-3, 5e-4, 0])), 1e-5))
    assert [point.name for point in found.rejected] == ["g0/B"]
    upright = rotation(np.random.default_rng(14))[:, 2]
    with pytest.raises(DataError) as refused:
        fit_survey(four(SQUARE, 1e-3 * upright), noise, common_shift=True, least=3, what="targets")
    assert all(f"g0/{label}" in refused.value.what for label in "ABCD")
