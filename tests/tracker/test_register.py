from dataclasses import replace

import numpy as np
import pytest

from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.numerics.so3 import exp
from tdfscal.records import FloatArray, PointSet
from tdfscal.trackercal.best_fit import PointRegistration, register
from tests.words import in_words

from .world import chi2_bounds, error_vector, points, rotation, squared

LABELS = ["A", "B", "C", "D", "E", "F", "G", "H"]


def pair(
    seed: int, count: int = 6, noise: float = 1e-5, std: float | None = 1.0
) -> tuple[PointSet, PointSet, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    x, R, t = rng.uniform(-0.5, 0.5, size=(count, 3)), rotation(rng), np.array([4.0, 1.0, 0.5])
    y = x @ R.T + t + noise * rng.normal(size=x.shape)
    stated = None if std is None else np.full_like(y, noise * std)
    group = ["frame"] * count
    return points(group, LABELS[:count], y, stated), points(group, LABELS[:count], x), R, t


def turned(truth: FloatArray, result: PointRegistration) -> float:
    return squared(error_vector(truth, result.rotation), result.covariance[:3, :3])


@pytest.mark.parametrize("std", [1.0, None, 0.1])
def test_transform_and_its_uncertainty(std: float | None) -> None:
    """By what is stated, or by the residuals: where nothing is, or far too little."""
    total = 0.0
    for seed in range(30):
        measured, reference, R, t = pair(seed, std=std)
        result = register(measured, reference)
        d = np.concatenate([error_vector(R, result.rotation), t - result.translation])
        total += squared(d, result.covariance)
    low, high = chi2_bounds(180)
    if std != 1.0:
        # With noise estimated on 12 degrees of freedom, each sixth is F(6, 12): mean 6/5,
        # variance 24/25. A scale beside takes one more.
        low, high = (6 * (30 * 1.2 + sign * 3.7 * np.sqrt(30 * 0.96)) for sign in (-1, 1))
    assert low < total < high


def test_permuted_names_are_found() -> None:
    measured, reference, _, _ = pair(5, count=8)
    labels = list(measured.point)
    labels[1], labels[4], labels[6] = labels[4], labels[6], labels[1]
    with pytest.raises(DataError, match="names") as caught:
        register(replace(measured, point=tuple(labels)), reference)
    for old, new in (("E", "B"), ("G", "E"), ("B", "G")):
        assert f"frame/{old} is frame/{new}" in str(caught.value)


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1e3, "mm read as m"), (25.4, "inches read as mm"), (1 / 0.0254, "inches read as m")],
)
@pytest.mark.parametrize("std", [1.0, None])
def test_wrong_units_are_named(factor: float, said: str, std: float | None) -> None:
    measured, reference, _, _ = pair(6, std=std)
    for a, b in (
        (replace(measured, xyz=measured.xyz * factor), reference),
        (measured, replace(reference, xyz=reference.xyz * factor)),
    ):
        with pytest.raises(DataError, match=said):
            register(a, b)


def test_a_small_scale_is_shown_not_applied() -> None:
    measured, reference, _, _ = pair(7)
    warm = replace(reference, xyz=reference.xyz / 1.0002)
    result = register(measured, warm)
    assert abs(result.scale - 1.0002) < 4 * result.scale_std
    assert abs(result.scale - 1) > 5 * result.scale_std
    assert any("ppm" in w for w in in_words(result.findings))
    assert np.linalg.norm(result.rotation, axis=0) == pytest.approx(1, abs=1e-12)


def test_mirror_and_line_are_refused() -> None:
    measured, reference, _, _ = pair(8)
    with pytest.raises(DataError, match="mirror"):
        register(replace(measured, xyz=measured.xyz * [1, 1, -1]), reference)
    other = np.random.default_rng(1).uniform(-0.5, 0.5, (6, 3))
    for std in (measured.std, None):
        with pytest.raises(NotIdentifiableError, match="no one body"):
            register(replace(measured, std=std, xyz=other), reference)
    line = np.arange(6)[:, None] * [0.1, 0.2, 0] + 1e-7 * np.eye(6)[:, :3]
    seen = line + 1e-5 * np.random.default_rng(1).normal(size=(6, 3))
    with pytest.raises(NotIdentifiableError, match="line"):
        register(replace(measured, xyz=seen), replace(reference, xyz=line))


CAD = {
    "cube": np.array([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)]),
    "targets": np.array([[50.0, 50, 0], [-50, 50, 0], [-50, -50, 0], [50, -50, 20]]) / 1e3,
    "92 points": np.random.default_rng(0).uniform(-0.5, 0.5, size=(92, 3)),
}


@pytest.mark.parametrize("name", CAD)
@pytest.mark.parametrize("off", [0.0, 1e-12])
def test_a_perfect_fit_has_the_uncertainty_of_what_is_written(name: str, off: float) -> None:
    """Not refused, nothing left out, though one point is off by a millionth of a micrometre."""
    x = CAD[name]
    R, t = rotation(np.random.default_rng(1)), np.array([4.0, 1.0, 0.5])
    labels = [f"P{i}" for i in range(len(x))]
    y = x @ R.T + t
    y[1, 0] += off
    names = ["frame"] * len(x), labels
    result = register(points(*names, y), points(*names, x))
    assert not result.rejected
    assert np.abs(error_vector(R, result.rotation)).max() < 1e-10
    assert np.abs(result.translation - t).max() < 1e-10
    assert result.sigma == pytest.approx(1e-9, rel=1e-6)  # a nanometre, the least there is


def test_points_are_paired_as_asked() -> None:
    measured, reference, R, _ = pair(20)
    other = replace(measured, group=("station",) * 6)
    renumbered = replace(measured, point=tuple("123456"), group=("",) * 6)
    nameless = replace(measured, group=("",) * 6)
    in_one = replace(nameless, point=tuple(f"FRAME_{p}" for p in measured.point))
    for result in (
        register(other, reference, match="point"),
        register(other, reference, groups={"station": "frame"}),
        register(renumbered, reference, match="order"),
        register(nameless, reference),
        register(in_one, reference),
        register(measured, replace(reference, group=("",) * 6)),
    ):
        assert len(result.names) == 6
        assert turned(R, result) < chi2_bounds(3)[1]
    with pytest.raises(DataError, match="--match"):
        register(renumbered, reference)
    with pytest.raises(DataError, match="no group mine"):
        register(other, reference, groups={"mine": "frame"})
    fewer = replace(reference, group=("f",) * 5, point=reference.point[1:], xyz=reference.xyz[1:])
    with pytest.raises(DataError, match=r"6 points.*5"):
        register(measured, fewer, match="order")
    twins = replace(measured, group=("a", "b", *measured.group[2:]), point=("A", *"ACDEF"))
    with pytest.raises(DataError, match="several points A"):
        register(twins, reference, match="point")


def named(xyz: FloatArray) -> PointSet:
    """Points of one group, without any uncertainty."""
    names = tuple(f"P{k}" for k in range(len(xyz)))
    return PointSet(("",) * len(xyz), names, xyz, None, "file")


@pytest.mark.parametrize(("count", "off"), [(5, 1), (8, 2), (20, 2), (20, 3), (92, 2)])
def test_outlying_points_are_found_by_the_others_alone(count: int, off: int) -> None:
    rng = np.random.default_rng(count + off)
    reference = rng.uniform(-1, 1, (count, 3))
    truth = exp(rng.normal(size=3))
    measured = reference @ truth.T + [3.0, -2.0, 1.0] + 2e-5 * rng.normal(size=(count, 3))
    bad = rng.choice(count, off, replace=False)
    away = rng.normal(size=(off, 3))
    measured[bad] += 5e-3 * away / np.linalg.norm(away, axis=1, keepdims=True)
    fit = register(named(measured), named(reference))
    assert {r.name for r in fit.rejected} == {named(reference).point[k] for k in bad}
    assert turned(truth, fit) < chi2_bounds(3)[1]
    assert fit.sigma is not None
    low, high = chi2_bounds(fit.dof)
    assert low < fit.dof * (fit.sigma / 2e-5) ** 2 < high


def test_a_group_that_has_moved_is_not_left_out() -> None:
    rng = np.random.default_rng(5)
    reference = rng.uniform(-1, 1, (20, 3))
    group = ("a",) * 15 + ("b",) * 5
    measured = reference + 2e-5 * rng.normal(size=(20, 3)) + 2e-3 * (np.arange(20) >= 15)[:, None]
    sets = [replace(named(xyz), group=group) for xyz in (measured, reference)]
    fit = register(*sets)
    assert fit.rejected == ()
    assert [(f.code, f.subject) for f in fit.findings] == [("groups-moved", ("a", "b"))]
