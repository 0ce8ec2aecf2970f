"""Parts of a rig file that contradict one another: refused at their place, and only then."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticCustomError
from scipy.spatial.transform import Rotation

from tdfscal.files.rig.model import check_hinges, check_inertia
from tdfscal.files.rig.recorders import LogBlock, check_recorders

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


def test_an_inertia_is_symmetric() -> None:
    for scale in (1e-3, 1.0, 1e5):
        matrix = scale * np.diag([40.0, 50.0, 30.0])
        matrix[0, 1] = scale * 40.0 * 1e-10
        check_inertia(matrix)
        matrix[0, 1] = scale * 40.0 * 1e-7
        with pytest.raises(PydanticCustomError, match="symmetric"):
            check_inertia(matrix)


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


def block(
    fields: Mapping[tuple[str, str], tuple[str, ...]], files: str | None, **more: Any
) -> LogBlock:
    """A recorder's block of these fields."""
    supports: dict[str, dict[str, tuple[str, ...]]] = {}
    for (name, what), named in fields.items():
        supports.setdefault(name, {})[what] = named
    return LogBlock.model_validate({"files": files, "supports": supports, **more})


def check_mapping(
    names: Sequence[str], *fields: Mapping[tuple[str, str], tuple[str, ...]], one: bool = True
) -> None:
    blocks = [block(own, None if one else f"{k}*.csv") for k, own in enumerate(fields)]
    check_recorders(names, blocks[0] if one and len(blocks) == 1 else blocks)


FIELDS = {
    (name, what): tuple(f"{name}.{what}.{axis}" for axis in "xyz")
    for name in ("a", "b", "c")
    for what in ("position", "force")
}


def test_a_mapping_serves_every_support_with_fields_of_its_own() -> None:
    names = ["a", "b", "c"]
    check_mapping(names, FIELDS)
    for name in names:
        rest = {key: fields for key, fields in FIELDS.items() if key[0] != name}
        assert place_of(check_mapping, names, rest) == ("log", "supports")
    more = FIELDS | {("d", "force"): ("q",)}
    assert place_of(check_mapping, names, more) == ("log", "supports", "d")
    twice = copy.copy(FIELDS)
    twice["c", "force"] = ("c.force.x", "a.position.y", "c.force.z")
    assert place_of(check_mapping, names, twice) == ("log", "supports", "c", "force")


def test_several_recorders_give_each_quantity_once() -> None:
    names = ["a", "b", "c"]
    apart = partial(check_mapping, names, one=False)
    moves, loads = (
        {key: fields for key, fields in FIELDS.items() if key[1] == what}
        for what in ("position", "force")
    )
    apart(moves, loads)
    apart(moves, {key: moves[key[0], "position"] for key in loads})  # in other files
    assert place_of(apart, moves, FIELDS) == ("log", 1, "supports", "a", "position")
    fewer = {key: fields for key, fields in loads.items() if key[0] != "b"}
    assert place_of(apart, moves, fewer) == ("log",)
    assert place_of(check_mapping, names, moves, loads) == ("log", 0)  # no files named


@pytest.mark.parametrize("odd", ["ncp3", "qqq"])
def test_a_support_that_is_misspelt_is_told_which_one_is_meant(odd: str) -> None:
    """The only one without fields."""
    fields = {(name, "force"): (name,) for name in ("ncp1", odd, "arm")}
    with pytest.raises(PydanticCustomError) as refused:
        check_mapping(["ncp1", "ncp2", "arm"], fields)
    assert refused.value.context is not None
    assert "`ncp2`" in refused.value.context["hint"]


def test_temperatures_are_one_for_all_or_one_each() -> None:
    names = ["a", "b", "c"]
    for fine in (["T"], ["T1", "T2", "T3"], {"a": "T1", "b": "T2", "c": "T3"}):
        check_recorders(names, block(FIELDS, None, temperature=fine))
    for wrong, odd in (([], None), (["T1", "T2"], None), (["T"] * 4, None),
                       ({"a": "T1", "b": "T2"}, "c"),
                       ({"a": "T1", "b": "T2", "c": "T3", "d": "T4"}, "d")):  # fmt: skip
        with pytest.raises(PydanticCustomError) as refused:
            check_recorders(names, block(FIELDS, None, temperature=wrong))
        assert refused.value.context is not None
        assert refused.value.context["place"][:2] == ("log", "temperature")
        if odd:
            assert f"`{odd}`" in refused.value.context["said"]
