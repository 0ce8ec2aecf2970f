"""From a point file to a PointSet in m; every refusal names the line. Its shape in JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import model_validator

from tdfscal.errors import DataError
from tdfscal.files.field_types import LengthUnit, NotNegative, Number, Strict, Text, fault, key
from tdfscal.files.model_errors import checked
from tdfscal.files.points.columns import Columns, refuse, to_metres
from tdfscal.files.points.table import Preamble, Table, read_table, read_text
from tdfscal.files.rig.recorders import TrackerFiles
from tdfscal.files.yaml import parse_document
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.records import FloatArray, PointSet, TrackerSession
from tdfscal.significance import COVERAGE_FACTOR


class Point(Strict):
    """One point: the support's name, the point's label, coordinates, standard uncertainties."""

    group: Text = key("name of the support")
    point: Text = key("the point's label")
    x: Number = key("coordinate, in length_unit")
    y: Number = key("coordinate, in length_unit")
    z: Number = key("coordinate, in length_unit")
    ux: NotNegative | None = key("standard uncertainty of x (k = 1); all three or none", None)
    uy: NotNegative | None = key("standard uncertainty of y", None)
    uz: NotNegative | None = key("standard uncertainty of z", None)

    @model_validator(mode="after")
    def _all_or_no_uncertainties(self) -> Self:
        given = [u is not None for u in (self.ux, self.uy, self.uz)]
        if any(given) and not all(given):
            raise fault("gives some of ux, uy, uz only", hint="give all three or none")
        return self


class PointFile(Strict):
    """Points of one file; x, y, z, ux, uy, uz in `length_unit`, ux, uy, uz with k = 1."""

    points: tuple[Point, ...] = key("list of points")
    length_unit: LengthUnit = key("unit of all coordinates and uncertainties")

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        seen: dict[tuple[str, str], int] = {}
        for index, point in enumerate(self.points):
            first = seen.setdefault((point.group, point.point), index)
            if first != index:
                raise fault(
                    f"{point.group}/{point.point} is points[{first}] already",
                    *("points", index),
                    hint="give each point of a group a name of its own",
                )
        return self


def found_in(code: str, source: str, **values: Value) -> Finding:
    """Return a finding about a point file."""
    return Finding(code, (source,), values=values)


@record
class PointReading:
    """A point file as read, and what a reader of the result should know of it."""

    points: PointSet
    findings: tuple[Finding, ...]


def read_tracker_session(files: TrackerFiles) -> tuple[TrackerSession, tuple[Finding, ...]]:
    """Read a survey and what is found of its files; errors as `read_point_file`."""
    read = [read_point_file(path, length_unit=files.stated.length_unit) for path in files.paths]
    session = TrackerSession(
        files.instrument, files.stated.drawing, *(file.points for file in read)
    )
    return session, tuple(found for file in read for found in file.findings)


def read_point_file(path: Path | str, *, length_unit: str | None) -> PointReading:
    """Read a point file, and find what was assumed: coverage, names, columns ignored.

    length_unit : of a file that names none. Coordinates in m, standard uncertainties with k = 1.

    Raises
    ------
    UsageError : the file cannot be opened.
    DataError : it is not a point file that can be used: no unit, polar axes, probe offsets,
        no number where one should be, one name for two points; the message names the line.
    """
    path = Path(path)
    text, source = read_text(path), str(path)
    if path.suffix.lower() == ".json":
        return PointReading(_parse_json(text, source), ())
    table, beside = read_table(text, source)
    columns = table.columns
    coordinate, uncertainty = _factors(columns, beside, length_unit, source)
    names, named = _names(table)
    xyz = _coordinates(table)
    # Whole numbers are a drawing's: exact, not readings that were rounded to a unit.
    digit = 0.0 if np.all(xyz == np.round(xyz)) else table.last_digit(columns.coordinates)
    std, stated = _stated(table, beside)
    found = [*named, *stated]
    if columns.ignored:
        found.append(found_in("columns-unused", source, columns=list(columns.ignored)))
    points = PointSet(
        group=tuple(group for group, _ in names),
        point=tuple(point for _, point in names),
        xyz=xyz * coordinate,
        std=None if std is None else std * uncertainty,
        source=source,
        resolution=digit * max(coordinate),
    )
    return PointReading(points, tuple(found))


def _parse_json(text: str, source: str) -> PointSet:
    """Read a point file in JSON. Raises DataError with the place of what is wrong in it."""
    file = checked(PointFile, parse_document(text.encode(), source, DataError), DataError)
    if not file.points:
        refuse(source, "holds no points", "check the export")
    factor = to_metres(file.length_unit, source)
    std = np.array([[p.ux, p.uy, p.uz] for p in file.points], dtype=np.float64)  # None is NaN
    return PointSet(
        group=tuple(p.group for p in file.points),
        point=tuple(p.point for p in file.points),
        xyz=factor * np.array([[p.x, p.y, p.z] for p in file.points]),
        std=None if np.isnan(std).all() else factor * std,
        source=source,
    )


def _factors(
    columns: Columns, beside: Preamble, length_unit: str | None, source: str
) -> tuple[FloatArray, FloatArray]:
    """Factors to m of the coordinates and of their uncertainties, (3,) each."""
    factor, own = columns.factors("x", "y", "z"), columns.factors("ux", "uy", "uz")
    named = np.isfinite(factor)
    fallback = np.nan
    if beside.unit is not None:
        fallback = to_metres(beside.unit, source)
        if np.any(factor[named] != fallback):
            line = "AXES line" if beside.axes else "unit line"
            what = f"the {line} and the column names give different units"
            refuse(source, what, "correct one of them")
    elif length_unit is not None:
        fallback = to_metres(length_unit, "length_unit")
    coordinate = np.where(named, factor, fallback)
    if np.isnan(coordinate).any():
        what = "no length unit: the file names none and neither does the rig file"
        hint = "name it in the header, as in `x [mm]`, or give it with --unit or `length_unit`"
        refuse(source, what, hint)
    return coordinate, np.where(np.isfinite(own), own, coordinate)


def _names(table: Table) -> tuple[list[tuple[str, str]], list[Finding]]:
    """Group and point of each row, and findings; without names they are numbered by their rows."""
    columns, source = table.columns, table.source
    points, groups = table.texts("point"), table.texts("group")
    found = []
    if points and columns.reflector and 2 * len(set(points)) <= len(points):
        found.append(found_in("column-of-reflectors", source, reflector=points[0]))
        points = []
    if not points:
        found.append(found_in("points-numbered", source))
        points = [str(k + 1) for k in range(len(table.rows))]
    names = []
    for k, point in enumerate(points):
        name = _apart(groups[k] if groups else "", point)
        if not name[1] or (groups and not name[0]):
            table.refuse(k, "has no group or no point name", "name the point")
        names.append(name)
    _refuse_repeated(table, names)
    return names, found


def _refuse_repeated(table: Table, names: Sequence[tuple[str, str]]) -> None:
    """Refuse two rows of one name: which of them holds nobody can tell."""
    seen: dict[tuple[str, str], int] = {}
    for k, name in enumerate(names):
        first = seen.setdefault(name, k)
        if first != k:
            number, label = table.lines[first].number, "/".join(filter(None, name))
            what = f"{label} stands in line {number} already"
            hint = "give each point of a group a name of its own; average repeated measurements"
            table.refuse(k, what, hint)


def _apart(group: str, point: str) -> tuple[str, str]:
    """Group and point of SpatialAnalyzer's `Collection::Group::Point`."""
    *path, last = point.split("::")
    return (group or (path[-1] if path else ""), last) if path else (group, point)


def _coordinates(table: Table) -> FloatArray:
    """Coordinates (N, 3) in the file's unit, of points and not of a probe beside them."""
    columns = table.columns
    offset = np.nan_to_num(table.numbers(columns.of("offset"), blank=True))
    for k, i in np.argwhere(offset != 0):
        labels = table.texts("point")
        label = labels[k] if labels else f"point {k + 1}"
        table.refuse(
            k,
            f"{label} has a probe offset of {table.rows[k][columns.of('offset')[i]]}: the "
            "coordinates are those of the probe, not of the point",
            "export offset-corrected points",
        )
    return table.numbers(columns.coordinates)


def _stated(table: Table, beside: Preamble) -> tuple[FloatArray | None, list[Finding]]:
    """Standard uncertainties (N, 3), in the file's unit, as `PointSet.std` has them; findings."""
    columns, source = table.columns, table.source
    if not columns.uncertainties:
        return None, []
    numbers = table.numbers(columns.uncertainties, blank=True)
    there = np.isfinite(numbers)
    for k, row in enumerate(there):
        if row.any() and not row.all():
            hint = "give all three, or none"
            table.refuse(k, "has an uncertainty for some of x, y and z only", hint)
        if np.any(numbers[k] < 0):
            table.refuse(k, "has a negative uncertainty", "check the line")
    found = []
    if columns.expanded:
        coverage = COVERAGE_FACTOR
        found.append(found_in("uncertainty-expanded", source, coverage=coverage))
        if beside.coverage not in (None, 1.0, coverage):
            what = f"has U(95) columns and names a coverage of {beside.coverage:g} sigma"
            refuse(source, what, "correct one of them")
    else:
        coverage = beside.coverage or 1.0
        if beside.coverage is not None:
            found.append(found_in("uncertainty-sigma", source, coverage=coverage))
        elif columns.bare:
            found.append(found_in("uncertainty-standard", source))
    std = None
    if np.any(numbers > 0):
        # A zero beside other uncertainties was rounded: it is anything below half a digit, and
        # the end of that interval is taken.
        rounded = table.last_digit(columns.uncertainties) / 2
        if np.any(numbers == 0):
            found.append(found_in("uncertainty-rounded", source, rounded=rounded))
        if not there.all():
            lacking = float(np.sum(~there.all(axis=1)))
            found.append(Finding("uncertainty-missing", (source,), lacking))
        std = np.where(numbers == 0, rounded, numbers) / coverage
    else:
        found.append(found_in("uncertainty-unstated", source, zero=bool(there.any())))
    return std, found
