"""From a point file to a PointSet in m; every refusal names the line. Its shape in JSON."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import model_validator

from tdfscal.errors import DataError
from tdfscal.files.field_types import LengthUnit, NotNegative, Number, Strict, Text, fault, key
from tdfscal.files.model_errors import checked
from tdfscal.files.points.table import Table, read_table, read_text, refuse, to_metres
from tdfscal.files.rig.recorders import TrackerBlock
from tdfscal.files.yaml import parse_document
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.records import FloatArray, PointSet, TrackerSession
from tdfscal.significance import COVERAGE_FACTOR

_XYZ, _UXYZ = ("x", "y", "z"), ("ux", "uy", "uz")


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


class PointFile(Strict):
    """Points of one file; x, y, z, ux, uy, uz in `length_unit`, ux, uy, uz with k = 1."""

    points: tuple[Point, ...] = key("list of points", min_length=1)
    length_unit: LengthUnit = key("unit of all coordinates and uncertainties")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        named = [(point.group, point.point) for point in self.points]
        for index, (name, point) in enumerate(zip(named, self.points, strict=True)):
            if (first := named.index(name)) < index:
                what = f"{'/'.join(name)} is points[{first}] already"
                hint = "give each point of a group a name of its own"
                raise fault(what, "points", index, hint=hint)
            if len({u is None for u in (point.ux, point.uy, point.uz)}) > 1:
                what = "gives some of ux, uy, uz only"
                raise fault(what, "points", index, hint="give all three or none")
        return self


@record
class PointReading:
    """A point file as read, and what a reader of the result should know of it."""

    points: PointSet
    findings: tuple[Finding, ...]


def read_tracker_session(
    stated: TrackerBlock, paths: Iterable[Path]
) -> tuple[TrackerSession, tuple[Finding, ...]]:
    """Read a survey and what is found of its files; errors as `read_point_file`."""
    read = [read_point_file(path, length_unit=stated.length_unit) for path in paths]
    instrument, points = stated.instrument.record(), (file.points for file in read)
    session = TrackerSession(instrument, stated.drawing, *points)
    return session, tuple(found for file in read for found in file.findings)


def read_point_file(path: Path | str, *, length_unit: str | None) -> PointReading:
    """Read a point file, and find what was assumed: coverage, names, columns ignored.

    length_unit : of a file that names none. Coordinates in m, standard uncertainties with k = 1.

    Raises UsageError where the file cannot be opened, DataError for what is no point file that can
    be used: no unit, polar axes, probe offsets, no number where one should be, one name for two
    points; the message names the line.
    """
    path = Path(path)
    text, source = read_text(path), str(path)
    if path.suffix.lower() == ".json":
        return PointReading(_parse_json(text, source), ())
    table = read_table(text, source)
    coordinate, uncertainty = _factors(table, length_unit)
    names, named = _names(table)
    for k, i in np.argwhere(np.nan_to_num(table.numbers("offset", blank=True)) != 0):
        what = (
            f"{names[k][1]} has a probe offset of {table.texts('offset')[k][i]}: the coordinates "
            "are those of the probe, not of the point"
        )
        table.refuse(k, what, "export offset-corrected points")
    xyz = table.numbers(*_XYZ)
    # Whole numbers are a drawing's: exact, not readings that were rounded to a unit.
    digit = 0.0 if np.all(xyz == np.round(xyz)) else table.last_digit(*_XYZ)
    std, stated = _stated(table)
    found = [*named, *stated]
    if ignored := table.ignored:
        found.append(_found("columns-unused", source, columns=ignored))
    points = PointSet(
        group=tuple(group for group, _ in names),
        point=tuple(point for _, point in names),
        xyz=xyz * coordinate,
        std=None if std is None else std * uncertainty,
        source=source,
        resolution=digit * max(coordinate),
    )
    return PointReading(points, tuple(found))


def _found(code: str, source: str, **values: Value) -> Finding:
    return Finding(code, (source,), values=values)


def _parse_json(text: str, source: str) -> PointSet:
    """Read a point file in JSON. Raises DataError with the place of what is wrong in it."""
    file = checked(PointFile, parse_document(text.encode(), source, DataError), DataError)
    factor = to_metres(file.length_unit, source)
    std = np.array([[p.ux, p.uy, p.uz] for p in file.points], dtype=np.float64)  # None is NaN
    return PointSet(
        group=tuple(p.group for p in file.points),
        point=tuple(p.point for p in file.points),
        xyz=factor * np.array([[p.x, p.y, p.z] for p in file.points]),
        std=None if np.isnan(std).all() else factor * std,
        source=source,
    )


def _factors(table: Table, length_unit: str | None) -> tuple[FloatArray, FloatArray]:
    """Factors to m of the coordinates and of their uncertainties, (3,) each."""
    units, source = table.units, table.source
    factor, own = (
        np.array([to_metres(units[role], source) if role in units else np.nan for role in roles])
        for roles in (_XYZ, _UXYZ)
    )
    named, fallback = np.isfinite(factor), np.nan
    if table.unit is not None:
        fallback = to_metres(table.unit, source)
        if np.any(factor[named] != fallback):
            line = "AXES line" if table.axes else "unit line"
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
    source = table.source
    points = [cell for cells in table.texts("point") for cell in cells]
    groups = [cell for cells in table.texts("group") for cell in cells]
    found = []
    if points and table.reflector and 2 * len(set(points)) <= len(points):
        found.append(_found("column-of-reflectors", source, reflector=points[0]))
        points = []
    if not points:
        found.append(_found("points-numbered", source))
        points = [str(k + 1) for k in range(len(table.rows))]
    names, seen = [], dict[tuple[str, str], int]()
    for k, label in enumerate(points):
        *path, point = label.split("::")  # SpatialAnalyzer's Collection::Group::Point
        name = ((groups[k] if groups else "") or (path[-1] if path else ""), point)
        if not point or (groups and not name[0]):
            table.refuse(k, "has no group or no point name", "name the point")
        if (first := seen.setdefault(name, k)) != k:  # which of them holds nobody can tell
            said = "/".join(filter(None, name))
            what = f"{said} stands in line {table.rows[first][0]} already"
            hint = "give each point of a group a name of its own; average repeated measurements"
            table.refuse(k, what, hint)
        names.append(name)
    return names, found


def _stated(table: Table) -> tuple[FloatArray | None, list[Finding]]:
    """Standard uncertainties (N, 3), in the file's unit, as `PointSet.std` has them; findings."""
    source = table.source
    if "ux" not in table.roles:
        return None, []
    numbers = table.numbers(*_UXYZ, blank=True)
    there = np.isfinite(numbers)
    for k, row in enumerate(there):
        if row.any() and not row.all():
            hint = "give all three, or none"
            table.refuse(k, "has an uncertainty for some of x, y and z only", hint)
        if np.any(numbers[k] < 0):
            table.refuse(k, "has a negative uncertainty", "check the line")
    if not np.any(numbers > 0):
        return None, [_found("uncertainty-unstated", source, zero=bool(there.any()))]
    coverage = COVERAGE_FACTOR if table.expanded else table.coverage or 1.0
    if table.expanded and table.coverage not in (None, 1.0, coverage):
        what = f"has U(95) columns and names a coverage of {table.coverage:g} sigma"
        refuse(source, what, "correct one of them")
    found = []
    if table.expanded or table.coverage is not None:
        code = "uncertainty-expanded" if table.expanded else "uncertainty-sigma"
        found.append(_found(code, source, coverage=coverage))
    elif table.bare:
        found.append(_found("uncertainty-standard", source))
    # A zero beside other uncertainties was rounded: it is anything below half a digit, and the end
    # of that interval is taken.
    rounded = table.last_digit(*_UXYZ) / 2
    if np.any(numbers == 0):
        found.append(_found("uncertainty-rounded", source, rounded=rounded))
    if not there.all():
        lacking = float(np.sum(~there.all(axis=1)))
        found.append(Finding("uncertainty-missing", (source,), lacking))
    return np.where(numbers == 0, rounded, numbers) / coverage, found
