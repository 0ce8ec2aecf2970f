"""Columns of a point table that no line names, from the number and the kind of its cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.points.columns import Columns
from tdfscal.files.points.numbers import as_number

_NONE = (None, None, None)
_NAMES = ("Collection", "group", "point")


def spatial_analyzer(count: int, uncertain: bool) -> Columns | None:
    """[Collection,] Group, Point, X, Y, Z and, where the file speaks of them, uncertainties."""
    numbers = 6 if uncertain and count in (8, 9) else 3
    names = count - numbers
    return _columns(names, numbers) if names in (2, 3) else None


def by_cells(rows: Sequence[Sequence[str]], uncertain: bool, comma: bool, where: str) -> Columns:
    """Up to three names, then x, y, z; and three more, which are a normal or uncertainties.

    uncertain : the file speaks of uncertainties. comma : decimal comma allowed. Raises
    DataError where the cells could mean something else.
    """
    count = len(rows[0])
    numbers_of = [[as_number(cell, comma=comma) for cell in row] for row in rows]
    names = next(
        (i for i in range(count) if all(r[i] is not None for r in numbers_of if i < len(r))), count
    )
    numbers = count - names
    if names == 0 and count == 4:  # a point's number, x, y, z
        names, numbers = 1, 3
    if names <= 3 and numbers == 3:
        return _columns(names, numbers)
    if names <= 3 and numbers == 6:
        if uncertain:
            return _columns(names, numbers)
        if _normals([row[-3:] for row in numbers_of if len(row) == count]):
            return _columns(names, numbers, normals=True)
    raise DataError(
        f"has {count} columns and no line that names them",
        where=where,
        hint="begin the file with a line such as `group,point,x,y,z`",
    )


def in_words(columns: Columns) -> str:
    """The columns as they were understood."""
    names = [
        "group" if i == columns.group else "point" if i == columns.point else "-"
        for i in range(columns.coordinate[0])
    ]
    rest = " and their uncertainties" if columns.uncertainty else ""
    return f"{', '.join([*names, 'x', 'y', 'z'])}{rest}"


def _columns(names: int, numbers: int, *, normals: bool = False) -> Columns:
    u = (names + 3, names + 4, names + 5) if numbers == 6 and not normals else None
    return Columns(
        count=names + numbers,
        group=names - 2 if names >= 2 else None,
        point=names - 1 if names else None,
        coordinate=(names, names + 1, names + 2),
        factor=_NONE,
        uncertainty=u,
        bare=u is not None,
        ignored=_NAMES[:1] * (names == 3) + ("i", "j", "k") * normals,
    )


def _normals(cells: Sequence[Sequence[float | None]]) -> bool:
    length = np.linalg.norm(np.array(cells, dtype=np.float64), axis=1)
    return bool(np.all(np.abs(length - 1) < 1e-3))
