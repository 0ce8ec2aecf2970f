"""Terminals built here, wrong in one known way or within what is stated, and what is said."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.checks.geometry import Geometry, examine
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig

STATED = DeclaredUncertainty(positioner=1e-5, hinge=2e-5)


@dataclass(frozen=True)
class Seen:
    """A stated rig, and what was logged: positions and forces (K, n, 3), BCS."""

    rig: Rig
    position: FloatArray
    force: FloatArray

    def examined(self, *, frames: bool = False) -> Geometry:
        variance = np.full(len(self.position), self.rig.declared.positioner**2)
        return examine(self.rig, self.position, variance, self.force, frames=frames)


def seen(
    rng: np.random.Generator,
    n: int = 3,
    radius: float = 2.0,
    *,
    stated: DeclaredUncertainty = STATED,
    hinge: FloatArray | float = 0.0,
    datum: FloatArray | float = 0.0,
    give: tuple[float, float] = (0.0, 0.0),
    tilt: float = 0.05,
    count: int = 24,
) -> Seen:
    """Postures of a lopsided terminal, off by hinge and datum (n, 3) beyond what is stated."""
    rig = replace(simulation.make_rig(n, radius=radius), declared=stated)
    rig = replace(rig, hinge=rig.hinge + 0.1 * radius * rng.normal(size=(n, 3)))
    true = rig.hinge + hinge + stated.hinge * rng.normal(size=(n, 3))
    R, T = so3.exp(tilt * rng.normal(size=(count, 3))), 0.05 * rng.normal(size=(count, 1, 3))
    force = 300.0 * rng.normal(size=(count, n, 3)) + np.array([0.0, 0.0, 1600.0])
    position = np.einsum("kab,nb->kna", R, true) + T + np.array([*give[:1], *give]) * force
    position += datum + stated.datum * rng.normal(size=(n, 3))
    return Seen(rig, position + stated.positioner * rng.normal(size=position.shape), force)


def at(n: int, i: int, vector: list[float]) -> FloatArray:
    out = np.zeros((n, 3))
    out[i] = vector
    return out


def test_sound_rigs_are_questioned_as_rarely_as_stated() -> None:
    """Of 120 rigs of many kinds; bounds that chance exceeds in 1 of 1000 such studies."""
    rng, p = np.random.default_rng(1), []
    for _ in range(120):
        stated = DeclaredUncertainty(
            positioner=rng.choice([5e-6, 5e-5]),
            hinge=rng.choice([0.0, 2e-5, 1e-3]),
            datum=rng.choice([0.0, 1e-4]),
            compliance_lateral=1e-6,
            compliance_vertical=1e-6,
        )
        give = 1e-6 * rng.normal(size=2)
        n, radius = int(rng.integers(3, 7)), float(rng.choice([0.6, 10.0]))
        case = seen(rng, n, radius, stated=stated, give=(give[0], give[1]), count=12)
        p.append(case.examined(frames=True).p_value)
    for level, most in ((0.2, 38), (0.05, 14), (0.01, 6)):  # quantiles of the binomial
        assert np.sum(np.array(p) < level) <= most


@pytest.mark.parametrize(("size", "radius"), [(1e-3, 2.0), (3e-3, 2.0), (15e-3, 10.0)])
@pytest.mark.parametrize("n", [3, 4, 6])
def test_a_displaced_hinge_is_named_with_its_size(size: float, radius: float, n: int) -> None:
    for trial in range(5):
        rng = np.random.default_rng([3, n, trial])
        turn = rng.uniform(-np.pi, np.pi)
        off = size * np.array([np.cos(turn), np.sin(turn), 0.0])
        found = seen(rng, n, radius, hinge=at(n, n - 1, list(off))).examined()
        (cause,) = (c for c in found.causes if (c.kind, c.support) == ("hinge", n - 1))
        assert all(c.support == n - 1 for c in found.causes) or n == 3
        assert found.explained
        seen_part = np.isfinite(cause.std)
        # The hinge's own error, and that of what it is held against, within χ² at a thousandth.
        short = np.linalg.norm((cause.amount - off)[seen_part]) - size**2 / radius
        if seen_part.all():
            limit = np.sqrt(chi2_quantile(0.999, 3)) * np.linalg.norm(cause.std)
            assert short < limit + STATED.hinge * 4


def test_an_offset_is_told_from_a_hinge_where_the_terminal_tilts() -> None:
    off = at(3, 1, [6e-4, 8e-4, 0.0])
    both = seen(np.random.default_rng(4), datum=off, tilt=1e-3).examined()
    assert {(c.kind, c.support) for c in both.causes} >= {("datum", 1), ("hinge", 1)}
    one = seen(np.random.default_rng(4), datum=off, tilt=0.1).examined()
    assert [(c.kind, c.support) for c in one.causes] == [("datum", 1)]
    assert one.causes[0].amount == pytest.approx(off[1], abs=2e-4)


def test_supports_that_give_pass_where_declared_and_are_named_where_not() -> None:
    soft = replace(STATED, compliance_lateral=3e-6, compliance_vertical=3e-6)
    for give in ((3e-6, 3e-6), (-3e-6, 0.0)):
        for stated, kinds in ((soft, []), (STATED, ["compliance"])):
            found = seen(np.random.default_rng(5), 4, stated=stated, give=give).examined()
            assert [cause.kind for cause in found.causes] == kinds


def test_all_hinges_too_far_apart_are_a_scale() -> None:
    case = seen(np.random.default_rng(7), 4)
    hinge = case.rig.hinge
    larger = hinge + 1e-3 * (hinge - hinge.mean(axis=0))
    found = replace(case, rig=replace(case.rig, hinge=larger)).examined()
    assert [cause.kind for cause in found.causes] == ["scale"]
    assert found.causes[0].amount[0] == pytest.approx(-1e-3, abs=2e-5)


def test_a_frame_is_blamed_only_where_distances_agree_on_average() -> None:
    """Turned about z by 1 mrad, with and without a hinge that is off."""
    turned = 1e-3 * so3.hat(np.array([0.3, -0.5, 0.8]))
    for off, kind in ((0.0, "turned"), (3e-3, "hinge")):
        case = seen(np.random.default_rng(9), 4, hinge=at(4, 1, [off, 0.0, 0.0]), tilt=0.1)
        away = case.position[:, 2] - case.position[:, 2].mean(axis=0)
        place = case.position.copy()
        place[:, 2] += (5 if kind == "turned" else 0.1) * away @ turned.T
        found = replace(case, position=place).examined(frames=True)
        assert found.causes[0].kind == kind
        assert found.causes[0].support == (2 if kind == "turned" else 1)


@pytest.mark.parametrize(("whose", "axes"), [(None, [2]), (1, [0, 1, 2])])
def test_coordinates_out_of_scale_are_named_with_the_line_to_write(
    whose: int | None, axes: list[int]
) -> None:
    """The heights of all positioners, which bend no distance on average; and all axes of one."""
    case = seen(np.random.default_rng(10), tilt=0.1)
    place = case.position + np.array([0.4, -0.3, 1.0])
    place[:, slice(None) if whose is None else [whose], axes] *= 1.005
    found = replace(case, position=place).examined(frames=True)
    assert (found.causes[0].kind, found.causes[0].support) == ("scaled from zero", whose)
    values = found.findings(case.rig)[0].values
    assert values["turned"] == ["<each>" if whose is None else "ncp2"]
    right = np.where(np.isin(np.arange(3), axes), 1 / 1.005, 1.0)
    assert values["signs"] == pytest.approx(right, abs=4 * found.causes[0].std.max())
