"""What the parts of a rig file must have in common, and a body its inertia."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Protocol

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


class Recorder(Protocol):
    """What is checked of a recorder's block."""

    @property
    def files(self) -> str | None: ...  # noqa: D102
    @property
    def rows(self) -> str: ...  # noqa: D102
    @property
    def supports(self) -> Mapping[str, object] | None: ...  # noqa: D102
    @property
    def fields(self) -> Mapping[tuple[str, str], tuple[str, ...]]: ...  # noqa: D102
    @property
    def temperature(self) -> Sequence[str] | Mapping[str, str] | None: ...  # noqa: D102


def check_recorders(names: Sequence[str], recorders: Sequence[Recorder], *, one: bool) -> None:
    """Refuse blocks that do not hold each support's position and force once, all together.

    one : the log is a block, no list of them.
    """
    held: dict[tuple[str, str], int] = {}
    for index, recorder in enumerate(recorders):
        place = ("log",) if one else ("log", index)
        _check_block(names, recorder, place, several=len(recorders) > 1)
        for what in recorder.fields:
            if what in held:
                raise fault(
                    f"the {what[1]} of {what[0]} is recorder {held[what] + 1}'s already",
                    *(*place, "supports", *what),
                    hint="let one recorder give each quantity",
                )
            held[what] = index
        if recorder.temperature is not None:
            check_temperature(names, recorder.temperature, place)
    if not any(recorder.supports is not None for recorder in recorders):
        return
    for name in names:
        missing = [what for what in ("position", "force") if (name, what) not in held]
        if len(missing) == 2:
            raise fault(f"lacks the support `{name}`", "log", "supports", hint=f"add `{name}: ...`")
        if missing:
            where = ("log", "supports", name) if one else ("log",)
            raise fault(
                f"lacks the {missing[0]} of `{name}`", *where, hint=f"add `{missing[0]}: ...`"
            )


def _check_block(
    names: Sequence[str], recorder: Recorder, place: tuple[str | int, ...], *, several: bool
) -> None:
    """Refuse a block that names other supports than the rig's, or a field twice."""
    if several and (recorder.files is None or recorder.supports is None):
        lacking = "files" if recorder.files is None else "supports"
        raise fault(f"lacks `{lacking}`", *place, hint=f"add `{lacking}: ...` for each recorder")
    if several and recorder.rows == "postures":
        raise fault(
            "averaged postures of several recorders have no time to bring them together",
            *(*place, "rows"),
            hint="give the recordings themselves",
        )
    for name in recorder.supports or ():
        _check_known(name, names, list(recorder.supports or ()), *place, "supports")
    taken: dict[str, str] = {}
    for (name, what), used in recorder.fields.items():
        for field in used:
            if field in taken:
                raise fault(
                    f"the field `{field}` already serves {taken[field]}",
                    *(*place, "supports", name, what),
                    hint="let each field serve one quantity",
                )
            taken[field] = f"log.supports.{name}.{what}"


def check_temperature(
    names: Sequence[str], fields: Sequence[str] | Mapping[str, str], block: tuple[str | int, ...]
) -> None:
    """Refuse temperature fields that are neither one for all nor one for each support."""
    place = (*block, "temperature")
    if not isinstance(fields, Mapping):
        if len(fields) not in (1, len(names)):
            raise fault(
                f"names {len(fields)} fields for {len(names)} supports",
                *place,
                hint="name one field for all, or one per support",
            )
    else:
        _check_each(names, list(fields), *place)


def _check_each(names: Sequence[str], given: Sequence[str], *place: str | int) -> None:
    """Refuse what is stated for other supports than the rig's, or not for all of them."""
    for name in given:
        _check_known(name, names, given, *place)
    for name in names:
        if name not in given:
            raise fault(f"lacks the support `{name}`", *place, hint=f"add `{name}: ...`")


def _check_known(name: str, names: Sequence[str], given: Sequence[str], *place: str | int) -> None:
    if name not in names:
        unused = [other for other in names if other not in given]
        near = nearest(name, unused or list(names), cutoff=0.0)
        hint = f"write `{near}` perhaps"
        raise fault(f"`{name}` is no support of this rig", *place, name, hint=hint)
