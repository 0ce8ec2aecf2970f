"""What the parts of a rig file must have in common, and a body its inertia."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from tdfscal.files.field_types import fault
from tdfscal.files.model_errors import nearest
from tdfscal.records import FloatArray

STRAIGHT = 1e-4
"""Hinges nearer to one line than this part of their extent do not fix the terminal's posture."""


def check_inertia(matrix: FloatArray) -> None:
    """Refuse a (3, 3) that is the inertia of no body: symmetric, positive, triangle inequality."""
    scale = float(np.abs(matrix).max())
    unit = matrix / (scale or 1.0)
    if not np.allclose(unit, unit.T, rtol=0, atol=1e-9):
        raise fault("must be a symmetric matrix", hint="make Ixy = Iyx and so on")
    smallest, middle, largest = np.linalg.eigvalsh(unit) * scale
    if smallest <= 0:
        raise fault(
            f"must be positive definite; its smallest principal moment is {smallest:.4g}",
            hint="check the signs of the products of inertia",
        )
    if largest - middle > smallest + 1e-9 * scale:
        raise fault(
            f"is the inertia of no body: the principal moment {largest:.4g} exceeds the sum of "
            f"the other two, {smallest:.4g} and {middle:.4g}",
            hint="check the entries",
        )


def check_names(names: Sequence[str]) -> None:
    """Refuse two supports of one name."""
    for index, name in enumerate(names):
        first = names.index(name)
        if first < index:
            raise fault(
                f"the name `{name}` is taken by supports[{first}]",
                *("supports", index, "name"),
                hint="give each support a name of its own",
            )


def check_hinges(names: Sequence[str], hinges: FloatArray) -> None:
    """Refuse hinges (n, 3) in m of which two coincide or which all lie on one line."""
    extent = np.linalg.svd(hinges - hinges.mean(axis=0), compute_uv=False)
    for i, j in combinations(range(len(names)), 2):
        if np.linalg.norm(hinges[i] - hinges[j]) <= STRAIGHT * extent[0]:
            raise fault(
                f"the hinges of `{names[i]}` and `{names[j]}` coincide",
                *("supports", j, "hinge"),
                hint="each NCP holds the terminal at a hinge of its own",
            )
    if extent[1] <= STRAIGHT * extent[0]:
        raise fault(
            "the hinges lie on one line, which leaves the terminal free to turn about it",
            "supports",
            hint="check the hinge coordinates",
        )


def check_mapping(names: Sequence[str], fields: Mapping[tuple[str, str], tuple[str, ...]]) -> None:
    """Refuse a log mapping that lacks a support, has one too many, or uses a field twice.

    fields : by support and quantity (`position` or `force`), the fields of the log.
    """
    place = ("log", "supports")
    _check_each(names, [name for name, _ in fields], *place)
    taken: dict[str, str] = {}
    for (name, what), used in fields.items():
        for field in used:
            if field in taken:
                raise fault(
                    f"the field `{field}` already serves {taken[field]}",
                    *place,
                    name,
                    what,
                    hint="let each field serve one quantity",
                )
            taken[field] = f"log.supports.{name}.{what}"


def check_temperature(names: Sequence[str], fields: Sequence[str] | Mapping[str, str]) -> None:
    """Refuse temperature fields that are neither one for all nor one for each support."""
    place = ("log", "temperature")
    if not isinstance(fields, Mapping):
        if len(fields) not in (1, len(names)):
            raise fault(
                f"names {len(fields)} fields for {len(names)} supports",
                *place,
                hint="name one field for all, or one per support",
            )
    else:
        _check_each(names, list(fields), *place)


def _check_each(names: Sequence[str], given: Sequence[str], *place: str) -> None:
    """Refuse what is stated for other supports than the rig's, or not for all of them."""
    for name in given:
        if name not in names:
            unused = [other for other in names if other not in given]
            near = nearest(name, unused or list(names), cutoff=0.0)
            hint = f"write `{near}` perhaps"
            raise fault(f"`{name}` is no support of this rig", *place, name, hint=hint)
    for name in names:
        if name not in given:
            raise fault(f"lacks the support `{name}`", *place, hint=f"add `{name}: ...`")
