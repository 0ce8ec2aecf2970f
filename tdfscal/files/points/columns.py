"""What the columns of a point table mean, by their names; units and numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NoReturn

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.field_types import LARGEST
from tdfscal.frozen import field, record
from tdfscal.records import FloatArray

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
#: Every spelling of a unit that is known, and which of METRES it means.
_UNITS = {
    spelling: unit
    for unit, spellings in {
        "m": ("m", "meter", "meters", "metre", "metres"),
        "cm": ("cm", "centimeter", "centimeters", "centimetre", "centimetres"),
        "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
        "um": ("um", "µm", "μm", "micron", "microns", "micrometer", "micrometre"),
        "in": ("in", "inch", "inches", '"'),
    }.items()
    for spelling in spellings
}
_NUMBER = re.compile(r"[+-]?(?:\d+\.?(\d*)|\.(\d+))(?:e([+-]?\d+))?", re.IGNORECASE)
_GAP = r"[\s_.-]*"
_MEASURED = r"(?:meas(?:ured)?|actual|act|ist|coord(?:inate)?)"
_UNIT = rf"(?:[\[(](?P<unit>[^\])]*)[\])]|[/_\s]\s*(?P<bare>{'|'.join(map(re.escape, _UNITS))}))?"
#: What stands before and after the axis in the names of each kind of column.
_COLUMN = {
    kind: re.compile(
        rf"{before}{_GAP}\(?(?P<axis>[xyz])\)?{after}\s*{_UNIT}",
        re.IGNORECASE,
    )
    for kind, before, after in (
        ("expanded", rf"u{_GAP}\(?\s*95\s*%?\s*\)?", ""),
        ("standard", r"(?:u|σ|sigma|std|sd|unc(?:ert(?:ainty)?)?)", ""),
        ("coordinate", rf"{_MEASURED}?", rf"(?:{_GAP}{_MEASURED})?"),
    )
}
_GROUP = ("group", "group name", "point group", "gruppe")
#: Names of the column with the points' names, the best first; `Target` is a reflector's type or,
#: in SpatialAnalyzer, the point.
_POINT = (
    "point", "point name", "pointname", "name", "point id", "pointid", "pt", "punkt", "punktname",
    "punktnummer", "label", "id", "feature", "element", "point number", "target id", "no", "nr",
    "number", "#", "index",
)  # fmt: skip
_TARGET = ("target", "target name")
_OFFSET = re.compile(r"offset|radius|probe|planar|radial", re.IGNORECASE)


@record
class Columns:
    """What each column of a table is.

    roles : of every column: group, point, x, y, z, ux, uy, uz, offset (which must be zero), or
    nothing. factor : by role, to m, where the header names a unit. expanded : the uncertainties are
    U(95). bare : they are such as SpatialAnalyzer's `U-x`, whose coverage stands elsewhere in the
    file. reflector : the point's column may hold the reflector's type instead. ignored : names.
    """

    roles: tuple[str, ...]
    factor: dict[str, float] = field(default_factory=dict)
    expanded: bool = False
    bare: bool = False
    reflector: bool = False
    ignored: tuple[str, ...] = ()

    def of(self, *roles: str) -> list[int]:
        """Numbers of the columns of these roles, in their order."""
        return [i for role in roles for i, own in enumerate(self.roles) if own == role]

    @property
    def coordinates(self) -> list[int]:
        """Numbers of x, y, z."""
        return self.of("x", "y", "z")

    @property
    def uncertainties(self) -> list[int]:
        """Numbers of ux, uy, uz; none where there are none."""
        return self.of("ux", "uy", "uz")

    def factors(self, *roles: str) -> FloatArray:
        """To m, NaN where the header names no unit."""
        return np.array([self.factor.get(role, np.nan) for role in roles])

    @property
    def needed(self) -> int:
        """Number of cells that a row has at least: the others may be left out at its end."""
        return 1 + max(self.of("x", "y", "z", "group", "point"))


def is_header(cells: Sequence[str]) -> bool:
    """Whether these cells name x, y and z."""
    found = {column[:2] for column in map(_parsed, cells) if column}
    return {("coordinate", axis) for axis in "xyz"} <= found


def read_header(cells: Sequence[str], where: str) -> Columns:
    """Columns from the cells of a header line; DataError where they do not make a point table."""
    names = [_without_bracket(cell.strip()) for cell in cells]
    folded = [name.lower() for name in names]
    units: dict[int, str | None] = {}
    kinds: dict[str, dict[str, int]] = {kind: {} for kind in _COLUMN}
    for i, name in enumerate(names):
        if (column := _parsed(name)) is not None:
            kind, axis, units[i] = column
            if kinds[kind].setdefault(axis, i) != i:
                refuse(where, f"names the column `{name}` twice", "leave one out")
    uncertain = kinds["expanded"] or kinds["standard"]
    if kinds["expanded"] and kinds["standard"]:
        refuse(where, "has both U(95) and u columns", "leave one kind of them out")
    if uncertain and set(uncertain) != set("xyz"):
        stated = ", ".join(sorted(uncertain))
        refuse(where, f"has uncertainties for {stated} only", "give them for all three, or none")
    point, target, group = (_first(folded, known) for known in (_POINT, _TARGET, _GROUP))
    roles = ["offset" if i not in units and _OFFSET.search(n) else "" for i, n in enumerate(names)]
    named: dict[str, int | None] = {"group": group, "point": target if point is None else point}
    named |= kinds["coordinate"] | {f"u{axis}": i for axis, i in uncertain.items()}
    for role, index in named.items():
        if index is not None:
            roles[index] = role
    return Columns(
        tuple(roles),
        {r: to_metres(u, where) for i, r in enumerate(roles) if r and (u := units.get(i))},
        expanded=bool(kinds["expanded"]),
        bare=any(re.match(r"U\W", names[i]) for i in kinds["standard"].values()),
        reflector=point is None and target is not None and group is None,
        ignored=tuple(name for name, role in zip(names, roles, strict=True) if name and not role),
    )


def spatial_analyzer(count: int, uncertain: bool) -> Columns | None:
    """[Collection,] Group, Point, X, Y, Z and, where the file speaks of them, uncertainties."""
    numbers: tuple[str, ...] = ("x", "y", "z")
    if uncertain and count in (8, 9):
        numbers += ("ux", "uy", "uz")
    collection = count - len(numbers) == 3
    if count - len(numbers) not in (2, 3):
        return None
    return Columns(
        (*("",) * collection, "group", "point", *numbers),
        bare=len(numbers) == 6,
        ignored=("Collection",) * collection,
    )


def _without_bracket(name: str) -> str:
    """A name that is bracketed as optional, alone or with its neighbours: `[U-x`, `U-z]`."""
    name = name.removeprefix("[")
    return name.removesuffix("]") if name.count("]") > name.count("[") else name


def _parsed(name: str) -> tuple[str, str, str | None] | None:
    """Kind, axis x, y or z, and unit as written, of a column's name."""
    for kind, pattern in _COLUMN.items():
        if found := pattern.fullmatch(name.strip()):
            return kind, found["axis"].lower(), found["unit"] or found["bare"]
    return None


def _first(names: Sequence[str], known: Sequence[str]) -> int | None:
    return next((names.index(name) for name in known if name in names), None)


def refuse(where: str, what: str, hint: str) -> NoReturn:
    """Raise DataError: where a file is at fault, what is wrong, what to do."""
    raise DataError(what, where=where, hint=hint)


def as_number(cell: str, *, comma: bool = False) -> float | None:
    """Return the number of a cell; None where it is none, or no length. comma : decimal comma."""
    text = _plain(cell, comma)
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if abs(value) <= LARGEST else None


def last_digit(cells: Iterable[str], *, comma: bool = False) -> float:
    """Return the worth of the last digit of the most finely written of these numbers; 0 of none."""
    found = (_NUMBER.fullmatch(_plain(cell, comma)) for cell in cells)
    exponents = (int(n[3] or 0) - len(n[1] or n[2] or "") for n in found if n is not None)
    return min((10.0**exponent for exponent in exponents), default=0.0)


def to_metres(unit: str, where: str) -> float:
    """Return the factor from `unit`, however spelt, to m; DataError where it is no length unit."""
    known = unit_of(unit)
    if known is None:
        what = f"`{unit.strip()}` is not a length unit known here"
        refuse(where, what, f"use one of {', '.join(METRES)}")
    return METRES[known]


def unit_of(text: str) -> str | None:
    """Return which of METRES a spelling means; None of another word."""
    return _UNITS.get(text.strip().lower().rstrip("."))


def _plain(cell: str, comma: bool) -> str:
    return cell.replace(",", ".") if comma and cell.count(",") == 1 and "." not in cell else cell
