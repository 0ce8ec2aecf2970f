"""What the columns of a point table mean: names, units, uncertainties, probe offsets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from tdfscal.errors import DataError
from tdfscal.files.points.units import to_metres

_COLUMN = re.compile(
    r"(?P<u95>u\s*\(?\s*95\s*%?\s*\)?\s*)?(?P<u>u_?)?(?P<axis>[xyz])\s*(?:[\[(](?P<unit>[^\])]*)[\])])?",
    re.IGNORECASE,
)
_GROUP = ("group", "group name", "point group", "gruppe")
_POINT = ("point", "point name", "point id", "target", "name", "id", "punkt")
_OFFSET = re.compile(r"offset|radius|probe|planar|radial", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Columns:
    """Where a table has what, by column number.

    coordinate, uncertainty : x, y, z; factor and uncertainty_factor take them to m and to k = 1,
    None where the header names no unit. offset : columns that must be zero.
    """

    count: int
    group: int
    point: int
    coordinate: tuple[int, int, int]
    factor: tuple[float | None, float | None, float | None]
    uncertainty: tuple[int, int, int] | None
    uncertainty_factor: tuple[float | None, float | None, float | None]
    expanded: bool
    offset: tuple[int, ...]
    ignored: tuple[str, ...]


def is_header(cells: Sequence[str]) -> bool:
    """Whether these cells name x, y and z."""
    axes = {m["axis"].lower() for m in map(_match, cells) if m and not m["u"] and not m["u95"]}
    return axes == {"x", "y", "z"}


def read_header(cells: Sequence[str], where: str) -> Columns:
    """Columns from the cells of a header line; DataError where they do not make a point table."""
    names = [cell.strip() for cell in cells]
    folded = [name.lower() for name in names]
    matches = [_match(name) for name in names]
    plain = {
        m["axis"].lower(): i for i, m in enumerate(matches) if m and not m["u95"] and not m["u"]
    }
    expanded = {m["axis"].lower(): i for i, m in enumerate(matches) if m and m["u95"]}
    standard = {
        m["axis"].lower(): i for i, m in enumerate(matches) if m and m["u"] and not m["u95"]
    }
    _refuse_repeated(names, matches, where)
    group, point = (
        _one(folded, known, label, where) for known, label in ((_GROUP, "group"), (_POINT, "point"))
    )
    if expanded and standard:
        raise DataError(
            "has both U(95) and u columns", where=where, hint="leave one kind of them out"
        )
    uncertain = expanded or standard
    if uncertain and set(uncertain) != set("xyz"):
        raise DataError(
            f"has uncertainties for {', '.join(sorted(uncertain))} only",
            where=where,
            hint="give them for x, y and z, or for none",
        )
    u = _three(uncertain) if uncertain else None
    offset = tuple(i for i, name in enumerate(names) if matches[i] is None and _OFFSET.search(name))
    used = {group, point, *plain.values(), *uncertain.values(), *offset}
    return Columns(
        count=len(names),
        group=group,
        point=point,
        coordinate=_three(plain),
        factor=_factors(matches, _three(plain), where),
        uncertainty=u,
        uncertainty_factor=_factors(matches, u, where) if u else (None, None, None),
        expanded=bool(expanded),
        offset=offset,
        ignored=tuple(names[i] for i in range(len(names)) if i not in used),
    )


def by_position(count: int, where: str) -> Columns:
    """Columns of a SpatialAnalyzer table that names none: [Collection,] Group, Point, X, Y, Z."""
    if count not in (5, 6):
        raise DataError(
            f"has {count} columns and no line that names them",
            where=where,
            hint="add the line `group,point,x,y,z`, or export with the column names",
        )
    first = count - 5
    none = (None, None, None)
    return Columns(
        count,
        first,
        first + 1,
        (first + 2, first + 3, first + 4),
        none,
        None,
        none,
        False,
        (),
        ("Collection",) * first,
    )


def _match(name: str) -> re.Match[str] | None:
    return _COLUMN.fullmatch(name.strip())


def _three(index: dict[str, int]) -> tuple[int, int, int]:
    return index["x"], index["y"], index["z"]


def _factors(
    matches: Sequence[re.Match[str] | None], columns: tuple[int, int, int], where: str
) -> tuple[float | None, float | None, float | None]:
    units = [match["unit"] if (match := matches[i]) else None for i in columns]
    x, y, z = (to_metres(unit, where) if unit is not None else None for unit in units)
    return x, y, z


def _one(names: Sequence[str], known: Sequence[str], label: str, where: str) -> int:
    found = [i for i, name in enumerate(names) if name in known]
    if len(found) != 1:
        what = "no column" if not found else f"{len(found)} columns"
        raise DataError(
            f"has {what} for the {label} in `{', '.join(names)}`",
            where=where,
            hint=f"name one column `{label}`",
        )
    return found[0]


def _refuse_repeated(
    names: Sequence[str], matches: Sequence[re.Match[str] | None], where: str
) -> None:
    seen: set[tuple[bool, bool, str]] = set()
    for name, m in zip(names, matches, strict=True):
        if m is None:
            continue
        key = (bool(m["u95"]), bool(m["u"]), m["axis"].lower())
        if key in seen:
            raise DataError(f"names the column `{name}` twice", where=where, hint="leave one out")
        seen.add(key)
