"""Surveys with one thing wrong: it is named, and what cannot be right is refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tdfscal.errors import NotIdentifiableError
from tdfscal.records import FloatArray, Instrument, PointSet
from tests.words import refusal

from .test_calibrate import calibrate, codes, distance
from .world import SQUARE, TRIPOD, chi2_bounds, make_survey, points


def displaced(pointset: PointSet, name: tuple[str, str], by: FloatArray) -> PointSet:
    xyz = pointset.xyz.copy()
    xyz[list(zip(pointset.group, pointset.point, strict=True)).index(name)] += by
    return replace(pointset, xyz=xyz)


@pytest.mark.parametrize("which", ["targets", "moves"])
def test_an_outlying_point_is_named_and_left_out(which: str) -> None:
    survey = make_survey(15, layout=0.1 * np.concatenate([TRIPOD, [[0, 0.2, 0.5], [0.5, 0, -0.3]]]))
    name = ("ncp2", "P3" if which == "targets" else "M4")
    bad = displaced(getattr(survey.session, which), name, np.array([0, 0, 1e-3]))
    result = calibrate(survey.with_session(**{which: bad}))
    assert [r.name for r in result.rejected] == ["/".join(name)]
    assert codes(result) == ["point-left-out"]
    assert distance(survey.X, result) < chi2_bounds(9)[1]


def relabelled(pointset: PointSet, group: str, order: str) -> PointSet:
    """Points of a group by each other's names."""
    here = [k for k, g in enumerate(pointset.group) if g == group]
    labels = list(pointset.point)
    for k, source in zip(here, order, strict=False):
        labels[k] = pointset.point[here[int(source)]]
    return replace(pointset, point=tuple(labels))


def mirrored(pointset: PointSet) -> PointSet:
    return replace(pointset, xyz=pointset.xyz * [1, -1, 1])


def of_each_other(pointset: PointSet) -> PointSet:
    """The points of two supports exchanged."""
    other = {"ncp1": "ncp2", "ncp2": "ncp1", "ncp3": "ncp3"}
    return replace(pointset, group=tuple(other[g] for g in pointset.group))


def without(pointset: PointSet, *rows: int) -> PointSet:
    kept = [k for k in range(len(pointset.xyz)) if k not in rows]
    group, point = pointset.group, pointset.point
    return points([group[k] for k in kept], [point[k] for k in kept], pointset.xyz[kept])


def scattered(pointset: PointSet) -> PointSet:
    rng, xyz = np.random.default_rng(1), pointset.xyz.copy()
    for k in rng.choice(len(xyz), 8, replace=False):
        xyz[k] += rng.normal(size=3) * 5e-3
    return replace(pointset, xyz=xyz)


def smaller(by: float) -> Callable[[PointSet], PointSet]:
    return lambda pointset: replace(pointset, xyz=pointset.xyz / by)


def uncertainless(_: Instrument) -> Instrument:
    return Instrument(0.0, 0.0, 0.0)


LINE = np.array([[-0.5, 0, 0], [0, 0, 1e-7], [0.5, 0, 0], [0.2, 0, 0]])
REFUSED: list[tuple[str, Callable[..., object], str, str]] = [
    # what is changed, how, the finding and what it says
    ("targets", lambda p: relabelled(p, "ncp3", "1023"), "points-misnamed", "ncp3/P2 is ncp3/P1"),
    ("moves", lambda p: relabelled(p, "ncp1", "015342"), "points-misnamed", "ncp1/M6 is ncp1/M3"),
    ("moves", of_each_other, "groups-misnamed", "ncp2"),
    ("moves", scattered, "points-off", "ncp1/M5"),
    ("nominal", mirrored, "points-mirrored", ""),
    ("moves", mirrored, "points-mirrored", ""),
    ("servo", smaller(1000.0), "points-rescaled", "mm read as m"),
    ("servo", smaller(25.4), "points-rescaled", "inches read as mm"),
    ("targets", lambda p: without(p, 4, 5), "targets-few", "ncp2/P1, ncp2/P2"),
    ("instrument", uncertainless, "points-certain", ""),
]


@pytest.mark.parametrize(("what", "change", "code", "said"), REFUSED)
def test_wrong_sessions(what: str, change: Callable[..., object], code: str, said: str) -> None:
    survey = make_survey(18, positioner=0.0 if what == "instrument" else 1e-5)
    wrong = survey.with_session(**{what: change(getattr(survey.session, what))})
    finding = refusal(calibrate, wrong)
    assert finding.code == code
    assert said in f"{finding.subject} {finding.values}"


def test_one_bad_target_of_four_in_a_plane_is_refused() -> None:
    """Out of the plane, four points have one redundancy: no one can say which of them is off."""
    survey = make_survey(15, layout=0.1 * SQUARE)
    normal = survey.tracker @ survey.X[1] @ [0, 0, 1]
    bad = displaced(survey.session.targets, ("ncp2", "P3"), 1e-3 * normal)
    finding = refusal(calibrate, survey.with_session(targets=bad))
    assert (finding.code, *finding.subject) == (
        "points-alike-off", "ncp2/P1", "ncp2/P2", "ncp2/P3", "ncp2/P4",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("setting", "said"),
    [({"layout": 0.1 * LINE}, "targets of ncp1"), ({"travel": 0.0}, "moved points")],
)
def test_points_on_a_line_are_not_identifiable(setting: dict[str, Any], said: str) -> None:
    with pytest.raises(NotIdentifiableError, match=said):
        calibrate(make_survey(24, **setting))


def test_what_a_survey_leaves_doubtful_is_said_and_nothing_of_a_sound_one() -> None:
    sound, square = make_survey(20), make_survey(20, layout=0.1 * SQUARE)
    assert codes(calibrate(sound)) == []
    flat = calibrate(square)
    assert flat.coplanar_targets == ("ncp1", "ncp2", "ncp3")
    assert "targets-symmetric" in codes(flat)
    targets = sound.session.targets
    for doubtful, code in (
        (of_each_other(targets), "targets-swapped"),
        (without(targets, 4), "points-not-measured"),
    ):
        assert code in codes(calibrate(sound.with_session(targets=doubtful)))
