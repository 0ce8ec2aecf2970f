"""From a point file to a PointSet in m; every refusal names the line."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdfscal.errors import DataError, UsageError
from tdfscal.files.points.columns import Columns, by_position, is_header, read_header
from tdfscal.files.points.units import to_metres
from tdfscal.records import PointSet

_AXES = re.compile(r"AXES\s*=\s*(?P<kind>[A-Za-z]+)(?P<rest>.*)", re.IGNORECASE)
_UNIT = re.compile(r"\(\s*([^()]+?)\s*\)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class PointReading:
    """A point file as read, and what a reader of the result should know of it."""

    points: PointSet
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    text: str


def read_points(path: Path | str, *, length_unit: str | None) -> PointSet:
    """Read a point file; coordinates in m, standard uncertainties with k = 1.

    length_unit : of a file that names none. See `read_point_file` for errors and for the notes.
    """
    return read_point_file(path, length_unit=length_unit).points


def read_point_file(path: Path | str, *, length_unit: str | None) -> PointReading:
    """Read a point file with notes on what was assumed: U(95) halved, columns ignored.

    Raises
    ------
    UsageError : the file cannot be opened.
    DataError : it is not a point file that can be used: no unit, polar axes, probe offsets,
        no number where one should be, a point twice; the message names the line.
    """
    path = Path(path)
    text = _text(path)
    if path.suffix.lower() == ".json":
        return PointReading(_from_json(text, str(path)), ())
    comments, lines = _split(text)
    if not lines:
        raise DataError("holds no points", where=str(path), hint="check the export")
    unit, cartesian = _axes(comments, str(path))
    delimiter = _delimiter(lines[-1].text)
    columns, rows = _columns(comments, lines, delimiter, cartesian, str(path))
    if not rows:
        raise DataError("holds a header, but no points", where=str(path), hint="check the export")
    factors = _all_factors(columns, unit, length_unit, str(path))
    return _table(rows, columns, factors, delimiter, str(path))


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"cannot be read: {error.strerror or error}", where=str(path), hint="check the path"
        ) from error
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "cp1252"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise DataError("is not a text file", where=str(path), hint="export the points as CSV")


def _from_json(text: str, source: str) -> PointSet:
    from tdfscal.files.model_errors import checked
    from tdfscal.files.points.model import PointFile
    from tdfscal.files.yaml.reading import parse_document

    file = checked(PointFile, parse_document(text.encode(), source, DataError), DataError)
    if not file.points:
        raise DataError("holds no points", where=source, hint="check the export")
    factor = to_metres(file.length_unit, source)
    stds = {(p.ux is None) for p in file.points}
    if len(stds) > 1:
        raise DataError(
            "gives uncertainties for some points only",
            where=source,
            hint="give ux, uy, uz for all points or for none",
        )
    return PointSet(
        group=tuple(p.group for p in file.points),
        point=tuple(p.point for p in file.points),
        xyz=factor * np.array([[p.x, p.y, p.z] for p in file.points]),
        std=None
        if stds == {True}
        else factor * np.array([[p.ux, p.uy, p.uz] for p in file.points], dtype=np.float64),
        source=source,
    )


def _split(text: str) -> tuple[list[_Line], list[_Line]]:
    """Comment lines without their marks, and the others; blank ones are skipped."""
    numbered = [
        _Line(n, line.strip()) for n, line in enumerate(text.splitlines(), 1) if line.strip()
    ]
    comments = [
        _Line(line.number, line.text.lstrip("/#").strip())
        for line in numbered
        if line.text.startswith(("//", "#"))
    ]
    return comments, [line for line in numbered if not line.text.startswith(("//", "#"))]


def _axes(comments: list[_Line], source: str) -> tuple[str | None, bool]:
    """Unit that an AXES comment names, and whether there is such a comment."""
    for line in comments:
        axes = _AXES.search(line.text)
        if axes is None:
            continue
        where = f"{source}, line {line.number}"
        if axes["kind"].upper() != "CARTESIAN":
            raise DataError(
                f"the coordinates are {axes['kind'].lower()}, not Cartesian",
                where=where,
                hint="export the points in Cartesian coordinates",
            )
        units = _UNIT.findall(axes["rest"])
        if units:
            to_metres(units[-1], where)
        return (units[-1] if units else None), True
    return None, False


def _delimiter(line: str) -> str | None:
    """The separator of a data line; None for white space."""
    for mark in (";", "\t", ","):
        if mark in line:
            return mark
    return None


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        # "X [mm]" and "U(95) X" are one name each.
        joined = re.sub(
            r"(?i)(u\s*\(\s*95\s*%?\s*\))\s+", r"\1", re.sub(r"\s+([\[(])", r"\1", line)
        )
        return joined.split()
    cells = [
        c.strip() for c in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    ]
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def _columns(
    comments: list[_Line],
    lines: list[_Line],
    delimiter: str | None,
    cartesian: bool,
    source: str,
) -> tuple[Columns, list[_Line]]:
    first = lines[0]
    where = f"{source}, line {first.number}"
    header = _cells(first.text, delimiter)
    if is_header(header):
        return read_header(header, where), lines[1:]
    for line in comments:
        named = _cells(line.text, _delimiter(line.text))
        if is_header(named) and not _AXES.search(line.text):
            return read_header(named, f"{source}, line {line.number}"), lines
    if any(_NUMBER.fullmatch(cell) for cell in header) and cartesian:
        return by_position(len(header), where), lines
    raise DataError(
        f"no line names the columns group, point, x, y and z; the first reads `{first.text[:60]}`",
        where=where,
        hint="begin the file with `group,point,x,y,z`",
    )


def _all_factors(
    columns: Columns, unit: str | None, length_unit: str | None, source: str
) -> tuple[list[float], list[float]]:
    """Factors to m of the coordinates and of their standard uncertainties."""
    from_axes = None if unit is None else to_metres(unit, source)
    named = [f for f in columns.factor if f is not None]
    if from_axes is not None and any(f != from_axes for f in named):
        raise DataError(
            "the AXES line and the column names give different units",
            where=source,
            hint="correct one of them",
        )
    fallback = from_axes
    if fallback is None and length_unit is not None:
        fallback = to_metres(length_unit, "length_unit")
    if fallback is None and len(named) < 3:
        raise DataError(
            "no length unit: the file names none and neither does the rig file",
            where=source,
            hint="name it in the header, as in `x [mm]`, or set `length_unit`",
        )
    pairs = zip(columns.factor, columns.uncertainty_factor, strict=True)
    coordinate, uncertainty = [], []
    for own, own_u in pairs:
        factor = own if own is not None else float(fallback or 0.0)
        coordinate.append(factor)
        uncertainty.append(
            (own_u if own_u is not None else factor) * (0.5 if columns.expanded else 1.0)
        )
    return coordinate, uncertainty


def _table(
    rows: list[_Line],
    columns: Columns,
    factors: tuple[list[float], list[float]],
    delimiter: str | None,
    source: str,
) -> PointReading:
    comma = delimiter in (";", "\t")
    seen: dict[tuple[str, str], int] = {}
    xyz, std = [], []
    for line in rows:
        where = f"{source}, line {line.number}"
        cells = _cells(line.text, delimiter)
        if len(cells) != columns.count:
            raise DataError(
                f"has {len(cells)} columns where {columns.count} are expected",
                where=where,
                hint="check the line; quote a name that has a comma or a blank in it",
            )
        name = cells[columns.group], cells[columns.point]
        if not all(name):
            raise DataError("has no group or no point name", where=where, hint="name the point")
        if name in seen:
            raise DataError(
                f"{name[0]}/{name[1]} stands in line {seen[name]} already",
                where=where,
                hint="give each point of a group a name of its own, or leave one out",
            )
        seen[name] = line.number
        for i in columns.offset:
            if cells[i] and _number(cells[i], where, comma) != 0:
                raise DataError(
                    f"{name[0]}/{name[1]} has a probe offset of {cells[i]}: the coordinates are "
                    "those of the probe, not of the point",
                    where=where,
                    hint="export offset-corrected points",
                )
        xyz.append(
            [
                f * _number(cells[i], where, comma)
                for i, f in zip(columns.coordinate, factors[0], strict=True)
            ]
        )
        if columns.uncertainty is not None:
            u = [
                f * _number(cells[i], where, comma)
                for i, f in zip(columns.uncertainty, factors[1], strict=True)
            ]
            if min(u) < 0:
                raise DataError("has a negative uncertainty", where=where, hint="check the line")
            std.append(u)
    notes = []
    if columns.expanded:
        notes.append(f"{source}: U(95) is taken as an expanded uncertainty, u = U(95)/2")
    if columns.ignored:
        notes.append(f"{source}: columns not used: {', '.join(columns.ignored)}")
    points = PointSet(
        group=tuple(group for group, _ in seen),
        point=tuple(point for _, point in seen),
        xyz=np.array(xyz),
        std=np.array(std) if std else None,
        source=source,
    )
    return PointReading(points, tuple(notes))


def _number(cell: str, where: str, comma: bool) -> float:
    text = cell.replace(",", ".") if comma and cell.count(",") == 1 and "." not in cell else cell
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(value):
        raise DataError(
            f"`{cell}` is not a finite number",
            where=where,
            hint="check the line",
        )
    return value
