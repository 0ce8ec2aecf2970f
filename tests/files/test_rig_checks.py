"""Parts of a rig file that contradict one another: refused at their place, and only then."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticCustomError
from scipy.spatial.transform import Rotation

from tdfscal.errors import RigError
from tdfscal.files.rig.model import check_hinges, check_inertia
from tdfscal.files.rig.reading import parse_rig
from tests.files.sample_documents import MINIMAL

Place = tuple[str | int, ...]


def place_of(check: Callable[..., object], *given: Any) -> Place:
    """Where a check finds a fault."""
    with pytest.raises(PydanticCustomError) as refused:
        check(*given)
    assert refused.value.context is not None
    return tuple(refused.value.context["place"])


def test_inertias_of_bodies() -> None:
    """Spheres, rods as good as without width, plates: at the bounds of what a body can have."""
    turn = Rotation.random(random_state=1).as_matrix()
    for principal in ([1.0, 1.0, 1.0], [1e-6, 1.0, 1.0], [1.0, 2.0, 3.0], [40.0, 50.0, 30.0]):
        for scale in (1e-3, 1.0, 1e5):
            matrix = scale * turn @ np.diag(principal) @ turn.T
            check_inertia((matrix + matrix.T) / 2)
    for principal in ([0.0, 1.0, 1.0], [-1e-3, 1.0, 1.0], [1.0, 2.0, 3.0 + 1e-6], [0.0, 0.0, 0.0]):
        for scale in (1e-3, 1.0, 1e5):
            with pytest.raises(PydanticCustomError):
                check_inertia(scale * np.diag(principal))


def test_hinges_that_coincide_or_stand_in_a_row() -> None:
    triangle = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    names = ["a", "b", "c", "d"]
    for size in (1e-2, 1.0, 1e2):
        for shift in (0.0, 7.0):
            check_hinges(names[:3], size * triangle + shift)
            four = np.concatenate([triangle, triangle[1:2] + np.array([0, 0, 5e-5])])
            found = place_of(check_hinges, names, size * four + shift)
            assert found == ("supports", 3, "hinge")
            four[3] += [0, 0, 5e-4]
            check_hinges(names, size * four + shift)
            row = triangle * [1, 5e-5, 1] + [[0, 0, 0], [0, 0, 0], [0.5, 0, 0]]
            assert place_of(check_hinges, names[:3], size * row + shift) == ("supports",)
            row[2, 1] = 1e-3
            check_hinges(names[:3], size * row + shift)


APART = """
log:
  - {files: "cnc*.csv", supports: {a: {position: pa}, b: {position: pb}, c: {position: pc}}}
  - {files: "daq*.csv", supports: {a: {force: fa}, b: {force: fb}, c: {force: fc}}}
"""


@pytest.mark.parametrize(
    ("old", "new", "place", "word"),
    [
        ("c: {force: fc}", "c: {force: fc, position: pc}", "log[1].supports.c.position", "already"),
        (", b: {force: fb}", "", "log", "lacks the force of `b`"),
        ('files: "daq*.csv", ', "", "log[1]", "lacks `files`"),
        ('files: "daq*.csv"', 'files: "daq*.csv", rows: postures', "log[1].rows", "no time"),
    ],
)
def test_recorders_give_each_quantity_once(old: str, new: str, place: str, word: str) -> None:
    assert APART.count(old) == 1
    with pytest.raises(RigError, match=re.escape(word)) as refused:
        parse_rig((MINIMAL + APART.replace(old, new)).encode(), "rig.yaml")
    assert str(refused.value.where).endswith(place)
