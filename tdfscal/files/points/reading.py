"""From a point file to a PointSet in m; every refusal names the line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.points.columns import (
    Columns,
    by_cells,
    in_words,
    is_header,
    read_header,
    spatial_analyzer,
)
from tdfscal.files.points.numbers import as_number, last_digit, to_metres
from tdfscal.files.points.text import (
    Line,
    Preamble,
    cells_of,
    delimiter_of,
    header_cells,
    read_preamble,
    read_text,
    split,
)
from tdfscal.files.points.uncertainties import coverage_of, standard_uncertainties
from tdfscal.files.rig.reading import TrackerFiles
from tdfscal.records import FloatArray, PointSet, TrackerSession

#: Lines before the header at most, as instruments write them about themselves.
_PREAMBLE = 60


@dataclass(frozen=True, slots=True)
class PointReading:
    """A point file as read, and what a reader of the result should know of it."""

    points: PointSet
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Table:
    """A table of cells: its columns, the line of each row, decimal comma allowed or not."""

    columns: Columns
    rows: tuple[tuple[Line, list[str]], ...]
    comma: bool
    source: str

    def where(self, row: int) -> str:
        return f"{self.source}, line {self.rows[row][0].number}"


def read_tracker_session(files: TrackerFiles) -> tuple[TrackerSession, tuple[str, ...]]:
    """Read a survey and the notes on its files; errors as `read_point_file`."""
    read = [read_point_file(path, length_unit=files.stated.length_unit) for path in files.paths]
    session = TrackerSession(
        files.instrument, files.stated.drawing, *(file.points for file in read)
    )
    return session, tuple(note for file in read for note in file.notes)


def read_point_file(path: Path | str, *, length_unit: str | None) -> PointReading:
    """Read a point file with notes on what was assumed: coverage, names, columns ignored.

    length_unit : of a file that names none. Coordinates in m, standard uncertainties with k = 1.

    Raises
    ------
    UsageError : the file cannot be opened.
    DataError : it is not a point file that can be used: no unit, polar axes, probe offsets,
        no number where one should be, a point twice; the message names the line.
    """
    path = Path(path)
    text, source = read_text(path), str(path)
    if path.suffix.lower() == ".json":
        return PointReading(_from_json(text, source), ())
    lines = split(text)
    data = [line for line in lines if not line.comment]
    if not data:
        raise DataError("holds no points", where=source, hint="check the export")
    table, beside, notes = _table(lines, data, source)
    coordinate, uncertainty = _factors(table.columns, beside, length_unit, source)
    names, named = _names(table)
    xyz, cells = _coordinates(table)
    # Whole numbers are a drawing's: exact, not readings that were rounded to a unit.
    digit = 0.0 if np.all(xyz == np.round(xyz)) else last_digit(cells, comma=table.comma)
    std, stated = _stated(table, beside, uncertainty)
    if table.columns.ignored:
        notes.append(f"{source}: columns not used: {', '.join(table.columns.ignored)}")
    points = PointSet(
        group=tuple(group for group, _ in names),
        point=tuple(point for _, point in names),
        xyz=xyz * coordinate,
        std=std,
        source=source,
        resolution=digit * max(coordinate),
    )
    return PointReading(points, (*named, *stated, *notes))


def _from_json(text: str, source: str) -> PointSet:
    from tdfscal.files.model_errors import checked
    from tdfscal.files.points.model import PointFile
    from tdfscal.files.yaml.reading import parse_document

    file = checked(PointFile, parse_document(text.encode(), source, DataError), DataError)
    if not file.points:
        raise DataError("holds no points", where=source, hint="check the export")
    factor = to_metres(file.length_unit, source)
    given = [p.ux is not None for p in file.points]
    nan = float("nan")
    std = [[nan if u is None else u for u in (p.ux, p.uy, p.uz)] for p in file.points]
    return PointSet(
        group=tuple(p.group for p in file.points),
        point=tuple(p.point for p in file.points),
        xyz=factor * np.array([[p.x, p.y, p.z] for p in file.points]),
        std=factor * np.array(std, dtype=np.float64) if any(given) else None,
        source=source,
    )


def _table(
    lines: Sequence[Line], data: Sequence[Line], source: str
) -> tuple[_Table, Preamble, list[str]]:
    """The table, what the lines beside it say, and a note where no line names the columns."""
    delimiter = delimiter_of(data[-1].text)
    header = _header(lines, data, delimiter)
    begin = 0 if header is None or header.comment else header.number
    body = [line for line in data if line.number > begin]
    if not body:
        raise DataError("holds a header, but no points", where=source, hint="check the export")
    inside = {line.number for line in body}
    beside = read_preamble([line for line in lines if line.number not in inside], source)
    rows = tuple((line, cells_of(line.text, delimiter)) for line in body)
    notes = []
    if header is not None:
        where = f"{source}, line {header.number}"
        columns = read_header(_cells_of_header(header, delimiter), where)
    else:
        columns, note = _nameless(rows, beside, delimiter != ",", source)
        notes = [note] if note else []
    table = _Table(columns, rows, delimiter != ",", source)
    for k, (_, cells) in enumerate(rows):
        if not columns.needed <= len(cells) <= columns.count:
            raise DataError(
                f"has {len(cells)} columns where {columns.count} are expected",
                where=table.where(k),
                hint="check the line; quote a name that has a comma or a blank in it",
            )
        cells += [""] * (columns.count - len(cells))
    return table, beside, notes


def _header(lines: Sequence[Line], data: Sequence[Line], delimiter: str | None) -> Line | None:
    """The line that names x, y and z: among the first of the file, or a comment."""
    first = [line for line in data[:_PREAMBLE] if is_header(_cells_of_header(line, delimiter))]
    comments = [
        line
        for line in lines
        if line.comment and "=" not in line.text and is_header(_cells_of_header(line, delimiter))
    ]
    return next(iter([*first, *comments]), None)


def _cells_of_header(line: Line, delimiter: str | None) -> list[str]:
    """Names of the columns; SpatialAnalyzer's comment may be delimited otherwise than the rows."""
    return header_cells(line.text, delimiter_of(line.text) if line.comment else delimiter)


def _nameless(
    rows: Sequence[tuple[Line, list[str]]], beside: Preamble, comma: bool, source: str
) -> tuple[Columns, str | None]:
    where = f"{source}, line {rows[0][0].number}"
    cells = [row for _, row in rows]
    if beside.axes and (columns := spatial_analyzer(len(cells[0]), beside.uncertain)):
        return columns, None
    if not any(as_number(cell, comma=comma) is not None for cell in cells[0]):
        raise DataError(
            "no line names the columns group, point, x, y and z; the first reads "
            f"`{rows[0][0].text[:60]}`",
            where=where,
            hint="begin the file with `group,point,x,y,z`",
        )
    columns = by_cells(cells, beside.uncertain, comma, where)
    return columns, f"{source}: no line names the columns; read as {in_words(columns)}"


def _factors(
    columns: Columns, beside: Preamble, length_unit: str | None, source: str
) -> tuple[FloatArray, FloatArray]:
    """Factors to m of the coordinates and of their uncertainties, (3,) each."""
    unit = None if beside.unit is None else to_metres(beside.unit, source)
    named = [f for f in columns.factor if f is not None]
    if unit is not None and any(f != unit for f in named):
        raise DataError(
            f"the {'AXES line' if beside.axes else 'unit line'} and the column names give "
            "different units",
            where=source,
            hint="correct one of them",
        )
    fallback = unit
    if fallback is None and length_unit is not None:
        fallback = to_metres(length_unit, "length_unit")
    if fallback is None and len(named) < 3:
        raise DataError(
            "no length unit: the file names none and neither does the rig file",
            where=source,
            hint="name it in the header, as in `x [mm]`, or give it with --unit or `length_unit`",
        )
    coordinate = np.array([f if f is not None else fallback for f in columns.factor])
    own = columns.uncertainty_factor
    return coordinate, np.array(
        [u if u is not None else f for u, f in zip(own, coordinate, strict=True)]
    )


def _names(table: _Table) -> tuple[list[tuple[str, str]], list[str]]:
    """Group and point of each row, and notes; rows are numbered where no column names them."""
    columns, source = table.columns, table.source
    points = None if columns.point is None else [row[columns.point] for _, row in table.rows]
    notes = []
    if points and columns.reflector and 2 * len(set(points)) <= len(points):
        notes.append(f"{source}: the column Target holds reflectors ({points[0]}), not points")
        points = None
    if points is None:
        notes.append(f"{source}: the points have no names; they are numbered by their rows")
        points = [str(k + 1) for k in range(len(table.rows))]
    seen: dict[tuple[str, str], int] = {}
    for k, (line, row) in enumerate(table.rows):
        group = "" if columns.group is None else row[columns.group]
        name = _apart(group, points[k])
        if not name[1] or (columns.group is not None and not name[0]):
            raise DataError(
                "has no group or no point name", where=table.where(k), hint="name the point"
            )
        if name in seen:
            label = "/".join(part for part in name if part)
            raise DataError(
                f"{label} stands in line {seen[name]} already",
                where=table.where(k),
                hint="give each point of a group a name of its own, or leave one out",
            )
        seen[name] = line.number
    return list(seen), notes


def _apart(group: str, point: str) -> tuple[str, str]:
    """Group and point of SpatialAnalyzer's `Collection::Group::Point`."""
    *path, last = point.split("::")
    return (group or (path[-1] if path else ""), last) if path else (group, point)


def _coordinates(table: _Table) -> tuple[FloatArray, list[str]]:
    """Coordinates (N, 3) in the file's unit, and their cells."""
    columns, cells = table.columns, list[str]()
    xyz = np.empty((len(table.rows), 3))
    for k, (_, row) in enumerate(table.rows):
        for i in columns.offset:
            if row[i] and _number(table, k, i) != 0:
                label = row[columns.point] if columns.point is not None else f"point {k + 1}"
                raise DataError(
                    f"{label} has a probe offset of {row[i]}: the coordinates are those of the "
                    "probe, not of the point",
                    where=table.where(k),
                    hint="export offset-corrected points",
                )
        xyz[k] = [_number(table, k, i) for i in columns.coordinate]
        cells += [row[i] for i in columns.coordinate]
    return xyz, cells


def _stated(
    table: _Table, beside: Preamble, factor: FloatArray
) -> tuple[FloatArray | None, list[str]]:
    """Standard uncertainties (N, 3), m, as `PointSet.std` has them, and notes."""
    columns = table.columns
    if columns.uncertainty is None:
        return None, []
    cells = [[row[i] for i in columns.uncertainty] for _, row in table.rows]
    numbers = np.full((len(cells), 3), np.nan)
    for k, row in enumerate(cells):
        if 0 < sum(map(bool, row)) < 3:
            raise DataError(
                "has an uncertainty for some of x, y and z only",
                where=table.where(k),
                hint="give all three, or none",
            )
        if all(row):
            numbers[k] = [_number(table, k, i) for i in columns.uncertainty]
        if np.any(numbers[k] < 0):
            raise DataError(
                "has a negative uncertainty", where=table.where(k), hint="check the line"
            )
    coverage, note = coverage_of(columns, beside.coverage, table.source)
    digit = last_digit((cell for row in cells for cell in row), comma=table.comma)
    std, notes = standard_uncertainties(numbers, digit, coverage, table.source)
    return None if std is None else std * factor, [*note, *notes]


def _number(table: _Table, row: int, column: int) -> float:
    cell = table.rows[row][1][column]
    value = as_number(cell, comma=table.comma)
    if value is None:
        raise DataError(
            f"`{cell}` is not a finite number", where=table.where(row), hint="check the line"
        )
    return value
