"""What the columns of a point table mean: by their names, or by what their cells hold."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.points.numbers import SPELLINGS, as_number, refuse, to_metres
from tdfscal.records import FloatArray

_BARE_UNIT = "|".join(map(re.escape, sorted(SPELLINGS, key=len, reverse=True)))
_GAP = r"[\s_.-]*"
_MEASURED = r"(?:meas(?:ured)?|actual|act|ist|coord(?:inate)?)"
#: What stands before and after the axis in the names of each kind of column.
_KINDS = {
    "expanded": (rf"u{_GAP}\(?\s*95\s*%?\s*\)?", ""),
    "standard": (r"(?:u|σ|sigma|std|sd|unc(?:ert(?:ainty)?)?)", ""),
    "nominal": (r"(?:nom(?:inal)?|soll|ref(?:erence)?)", ""),
    "coordinate": (rf"{_MEASURED}?", rf"(?:{_GAP}{_MEASURED})?"),
}
_COLUMN = {
    kind: re.compile(
        rf"{before}{_GAP}\(?(?P<axis>[xyz])\)?{after}\s*"
        rf"(?:[\[(](?P<unit>[^\])]*)[\])]|[/_\s]\s*(?P<bare>{_BARE_UNIT}))?",
        re.IGNORECASE,
    )
    for kind, (before, after) in _KINDS.items()
}
_GROUP = ("group", "group name", "point group", "gruppe")
#: Names of the column with the points' names, the best first; `Target` is a reflector's type or,
#: in SpatialAnalyzer, the point.
_POINT = (
    "point", "point name", "pointname", "name", "point id", "pointid", "point no", "point nr",
    "pt", "pt name", "pt id", "punkt", "punktname", "punktnummer", "label", "id", "feature",
    "object", "element", "object name", "feature name", "element name", "point number",
    "point label", "target id", "no", "no.", "nr", "nr.", "number", "#", "index",
)  # fmt: skip
_TARGET = ("target", "target name")
_OFFSET = re.compile(r"offset|radius|probe|planar|radial", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Columns:
    """Where a table has what, by column number.

    group, point : None where there is no such column. coordinate, uncertainty : x, y, z; factor
    and uncertainty_factor (3,) take them to m, NaN where the header names no unit. expanded : the
    uncertainties are U(95). bare : they are such as SpatialAnalyzer's `U-x`, whose coverage stands
    elsewhere in the file. reflector : the point's column may hold the reflector's type instead.
    offset : columns that must be zero.
    """

    count: int
    group: int | None
    point: int | None
    coordinate: Sequence[int]
    factor: FloatArray
    uncertainty: Sequence[int] | None
    uncertainty_factor: FloatArray
    expanded: bool = False
    bare: bool = False
    reflector: bool = False
    offset: Sequence[int] = ()
    ignored: tuple[str, ...] = ()

    @property
    def needed(self) -> int:
        """Number of cells that a row has at least: the others may be left out at its end."""
        return 1 + max(*self.coordinate, self.group or 0, self.point or 0)


@dataclass(frozen=True, slots=True)
class _Name:
    """What a column's name says: kind, axis x, y or z, and the unit as written."""

    kind: str
    axis: str
    unit: str | None


def is_header(cells: Sequence[str]) -> bool:
    """Whether these cells name x, y and z."""
    found = {(c.kind, c.axis) for c in map(_parsed, cells) if c}
    return any({(kind, axis) for axis in "xyz"} <= found for kind in ("coordinate", "nominal"))


def is_column_name(text: str) -> bool:
    """Whether a text is one column's name: several words of a line may be."""
    return _parsed(text) is not None or text.strip().lower() in (*_POINT, *_TARGET, *_GROUP)


def read_header(cells: Sequence[str], where: str) -> Columns:
    """Columns from the cells of a header line; DataError where they do not make a point table."""
    names = [cell.strip() for cell in cells]
    folded = [name.lower() for name in names]
    parsed = [_parsed(name) for name in names]
    kinds: dict[str, dict[str, int]] = {kind: {} for kind in _KINDS}
    for i, column in enumerate(parsed):
        if column is not None and kinds[column.kind].setdefault(column.axis, i) != i:
            refuse(where, f"names the column `{names[i]}` twice", "leave one out")
    coordinate = _xyz(kinds["coordinate"] if len(kinds["coordinate"]) == 3 else kinds["nominal"])
    uncertainty = _uncertainty(kinds, where)
    point = _first(folded, _POINT)
    target = _first(folded, _TARGET) if point is None else None
    group = _first(folded, _GROUP)
    offset = [i for i, name in enumerate(names) if parsed[i] is None and _OFFSET.search(name)]
    name = point if point is not None else target
    used = {group, name, *coordinate, *(uncertainty or ()), *offset}
    return Columns(
        count=len(names),
        group=group,
        point=name,
        coordinate=coordinate,
        factor=_factors(parsed, coordinate, where),
        uncertainty=uncertainty,
        uncertainty_factor=_factors(parsed, uncertainty or coordinate, where),
        expanded=bool(kinds["expanded"]),
        bare=any(re.match(r"U\W", names[i]) for i in kinds["standard"].values()),
        reflector=target is not None and group is None,
        offset=offset,
        ignored=tuple(names[i] for i in range(len(names)) if i not in used and names[i]),
    )


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
    if all(number is None for number in numbers_of[0]):
        what = "no line names the columns group, point, x, y and z; the first reads"
        hint = "begin the file with `group,point,x,y,z`"
        refuse(where, f"{what} {', '.join(rows[0])[:60]}", hint)
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
        last = np.array([row[-3:] for row in numbers_of if len(row) == count], dtype=np.float64)
        if np.all(np.abs(np.linalg.norm(last, axis=1) - 1) < 1e-3):
            return _columns(names, numbers, normals=True)
    hint = "begin the file with a line such as `group,point,x,y,z`"
    raise DataError(f"has {count} columns and no line that names them", where=where, hint=hint)


def in_words(columns: Columns) -> str:
    """The columns as they were understood."""
    names = [
        "group" if i == columns.group else "point" if i == columns.point else "-"
        for i in range(columns.coordinate[0])
    ]
    rest = " and their uncertainties" if columns.uncertainty else ""
    return f"{', '.join([*names, 'x', 'y', 'z'])}{rest}"


def _parsed(name: str) -> _Name | None:
    for kind, pattern in _COLUMN.items():
        if found := pattern.fullmatch(name.strip()):
            return _Name(kind, found["axis"].lower(), found["unit"] or found["bare"])
    return None


def _uncertainty(kinds: dict[str, dict[str, int]], where: str) -> list[int] | None:
    if kinds["expanded"] and kinds["standard"]:
        refuse(where, "has both U(95) and u columns", "leave one kind of them out")
    uncertain = kinds["expanded"] or kinds["standard"]
    if uncertain and set(uncertain) != set("xyz"):
        stated = ", ".join(sorted(uncertain))
        refuse(where, f"has uncertainties for {stated} only", "give them for all three, or none")
    return _xyz(uncertain) if uncertain else None


def _xyz(index: dict[str, int]) -> list[int]:
    return [index[axis] for axis in "xyz"]


def _factors(parsed: Sequence[_Name | None], which: Sequence[int], where: str) -> FloatArray:
    units = [column.unit for i in which if (column := parsed[i])]
    return np.array([np.nan if unit is None else to_metres(unit, where) for unit in units])


def _first(names: Sequence[str], known: Sequence[str]) -> int | None:
    return next((names.index(name) for name in known if name in names), None)


def _columns(names: int, numbers: int, *, normals: bool = False) -> Columns:
    u = range(names + 3, names + 6) if numbers == 6 and not normals else None
    return Columns(
        count=names + numbers,
        group=names - 2 if names >= 2 else None,
        point=names - 1 if names else None,
        coordinate=range(names, names + 3),
        factor=np.full(3, np.nan),
        uncertainty=u,
        uncertainty_factor=np.full(3, np.nan),
        bare=u is not None,
        ignored=("Collection",) * (names == 3) + ("i", "j", "k") * normals,
    )
