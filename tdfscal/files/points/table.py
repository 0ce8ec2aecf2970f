"""The table in a point file's text: its columns by their names, what lines beside it say, cells."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tdfscal.errors import DataError, visible
from tdfscal.files.field_types import LARGEST
from tdfscal.files.yaml import unreadable
from tdfscal.frozen import record
from tdfscal.records import FloatArray

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
#: Every spelling of a unit that is known, and which of METRES it means.
_UNITS = {
    spelling: unit
    for unit, spellings in {
        "m": "m meter meters metre metres",
        "cm": "cm centimeter centimeters centimetre centimetres",
        "mm": "mm millimeter millimeters millimetre millimetres",
        "um": "um µm μm micron microns micrometer micrometre",
        "in": 'in inch inches "',
    }.items()
    for spelling in spellings.split()
}
_NUMBER = re.compile(r"[+-]?(?:\d+\.?(\d*)|\.(\d+))(?:e([+-]?\d+))?", re.IGNORECASE)
_GAP = r"[\s_.-]*"
_MEASURED = r"(?:meas(?:ured)?|actual|act|ist|coord(?:inate)?)"
_UNIT = rf"(?:[\[(](?P<unit>[^\])]*)[\])]|[/_\s]\s*(?P<bare>{'|'.join(map(re.escape, _UNITS))}))?"
#: What stands before and after the axis in the names of each kind of column.
_COLUMN = {
    kind: re.compile(rf"{before}{_GAP}\(?(?P<axis>[xyz])\)?{after}\s*{_UNIT}", re.IGNORECASE)
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
#: Lines before the header at most, as instruments write them about themselves.
_PREAMBLE = 60
_AXES = re.compile(r"AXES\s*=\s*(?P<kind>[A-Za-z]+)(?P<rest>.*)", re.IGNORECASE)
_PARENTHESES = re.compile(r"\(\s*(?:in\s+)?([^()]+?)\s*\)")
_UNIT_LINE = re.compile(r"\b(?:length\s*)?units?\s*[:=]\s*\"?([^\s,;\"]+)", re.IGNORECASE)
#: "(1.0 sigma)", "2 Sigma", "Sigma = 2", "k = 2".
_SIGMA = re.compile(
    r"\(?\s*(?:(?P<before>\d+(?:[.,]\d+)?)\s*[-*]?\s*(?:sigma|σ)"
    r"|\b(?:sigma(?:\s+[a-z]+)?|coverage(?:\s+factor)?|k)\s*[:=]\s*(?P<after>\d+(?:[.,]\d+)?))\s*\)?",
    re.IGNORECASE,
)
_HEAD = (
    "begin the file with a line that names each column, such as `group,point,x,y,z`, all of them "
    "parted by commas, semicolons or tabs; a column that is not used may have any name"
)


@record
class Line:
    """A line that is not blank, without the mark of a comment: its number in the file, its text."""

    number: int
    text: str
    comment: bool = False


@record
class Table:
    """A table of cells, and what its header and lines beside it say.

    names : of the columns, as they stand. roles : of each: group, point, x, y, z, ux, uy, uz,
    offset (of a probe, which must be zero), or nothing. units : by role, where its name has one.
    rows : number of the line, and cells. comma : a decimal comma is one. unit : of length, None
    where none is named. axes : there is an AXES line of SpatialAnalyzer's. coverage : k of the
    uncertainties, None where none is named; expanded : they are U(95). bare : they are such as
    SpatialAnalyzer's `U-x`, whose coverage stands elsewhere in the file. reflector : the points'
    column may hold the reflector's type instead.
    """

    source: str
    names: Sequence[str]
    roles: Sequence[str]
    units: Mapping[str, str]
    rows: Sequence[tuple[int, list[str]]]
    comma: bool
    unit: str | None
    axes: bool
    coverage: float | None
    expanded: bool = False
    bare: bool = False
    reflector: bool = False

    @property
    def ignored(self) -> list[str]:
        """Names of the columns that say nothing here."""
        return [n for n, role in zip(self.names, self.roles, strict=True) if n and not role]

    def refuse(self, row: int, what: str, hint: str) -> NoReturn:
        """Raise DataError at a row."""
        refuse(f"{self.source}, line {self.rows[row][0]}", what, hint)

    def texts(self, *roles: str) -> list[list[str]]:
        """Return each row's cells of these roles."""
        which = [i for role in roles for i, own in enumerate(self.roles) if own == role]
        return [[cells[i] for i in which] for _, cells in self.rows]

    def numbers(self, *roles: str, blank: bool = False) -> FloatArray:
        """Return each row's numbers (N, roles); blank : a cell may be, and is not a number then."""

        def number(row: int, cell: str) -> float:
            text = self._plain(cell)
            if _NUMBER.fullmatch(text) and abs(float(text)) <= LARGEST:
                return float(text)
            if cell or not blank:
                what = (
                    "is beyond any length" if _NUMBER.fullmatch(text) else "is not a finite number"
                )
                self.refuse(
                    row, f"`{cell}` {what}" if cell else "a cell is empty", "check the line"
                )
            return np.nan

        return np.array([[number(k, cell) for cell in c] for k, c in enumerate(self.texts(*roles))])

    def last_digit(self, *roles: str) -> float:
        """Return what the last digit of the most finely written number is worth; 0 of none."""
        texts = (self._plain(cell) for row in self.texts(*roles) for cell in row)
        found = (number for text in texts if (number := _NUMBER.fullmatch(text)))
        exponents = (int(n[3] or 0) - len(n[1] or n[2] or "") for n in found)
        return min((10.0**exponent for exponent in exponents), default=0.0)

    def _plain(self, cell: str) -> str:
        """A number with a point for its decimal comma."""
        return cell.replace(",", ".") if self.comma and "." not in cell else cell


def refuse(where: str, what: str, hint: str) -> NoReturn:
    """Raise DataError: where a file is at fault, what is wrong, what to do."""
    raise DataError(what, where=where, hint=hint)


def to_metres(unit: str, where: str) -> float:
    """Return the factor from `unit`, however spelt, to m; DataError where it is no length unit."""
    known = _unit_of(unit)
    if known is None:
        what = f"`{unit.strip()}` is not a length unit known here"
        refuse(where, what, f"use one of {', '.join(METRES)}")
    return METRES[known]


def _unit_of(text: str) -> str | None:
    return _UNITS.get(text.strip().lower().rstrip("."))


def read_text(path: Path) -> str:
    """Return a file's text. Raises UsageError where it cannot be opened, DataError if no text."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "cp1252"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise DataError("is not a text file", where=str(path), hint="export the points as CSV")


def read_table(text: str, source: str) -> Table:
    """Find the table in a text; DataError where there is none of points."""
    lines = _split(text)
    data = [line for line in lines if not line.comment]
    delimiter = _delimiter_of(data[-1].text) if data else ","
    header, named = _header(lines, delimiter)
    begin = 0 if header is None or header.comment else header.number
    rows = [(x.number, _cells_of(x.text, delimiter)) for x in data if x.number > begin]
    if not rows:
        what = "holds a header, but no points" if data else "holds no points"
        refuse(source, what, "check the export")
    unit, axes, coverage = _stated((x for x in lines if x.comment or x.number <= begin), source)
    number, first = rows[0]
    if header is not None:
        columns = _columns(named, f"{source}, line {header.number}")
    elif axes and len(first) in (5, 6):  # of SpatialAnalyzer
        names = ("Collection", "group", "point", "x", "y", "z")[-len(first) :]
        roles = [name.removeprefix("Collection") for name in names]
        columns = {"names": names, "roles": roles, "units": {}}
    else:
        what = f"no line names the columns; the first reads {visible(', '.join(first)[:60])}"
        refuse(f"{source}, line {number}", what, _HEAD)
    stated: dict[str, Any] = {"rows": rows, "comma": delimiter != ",", "unit": unit, "axes": axes}
    table = Table(source, coverage=coverage, **stated, **columns)
    needed, expected = {"x", "y", "z", "group", "point"}, len(table.roles)
    least = 1 + max(i for i, role in enumerate(table.roles) if role in needed)
    for k, (_, cells) in enumerate(rows):
        if not least <= len(cells) <= expected:
            what = f"has {len(cells)} columns where {expected} are expected"
            table.refuse(k, what, "check the line; quote a name that has a comma in it")
        cells += [""] * (expected - len(cells))
    return table


def _split(text: str) -> list[Line]:
    """Lines with something in them; those that begin with // or # are comments."""
    lines = []
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        comment = line.startswith(("//", "#")) and not re.match(r"#\s*[;,\t]", line)
        if comment or line.strip(',;\t "'):
            said = line.lstrip("/#").strip() if comment else line
            lines.append(Line(number, said, comment))
    return lines


def _stated(lines: Iterable[Line], source: str) -> tuple[str | None, bool, float | None]:
    """Unit, whether axes are named, and coverage by lines beside the table, as `Table` has them.

    Raises DataError where they contradict each other or name other axes.
    """
    unit, axes = None, False
    coverage: float | None = None
    for line in lines:
        where = f"{source}, line {line.number}"
        for found in _SIGMA.finditer(line.text):
            k = float((found["before"] or found["after"]).replace(",", "."))
            if k <= 0 or coverage not in (None, k):
                earlier = f", an earlier line as {coverage:g}" if coverage else ""
                what = f"names the uncertainties' coverage as {k:g} sigma{earlier}"
                refuse(where, what, "correct the line")
            coverage = k
        if named := _AXES.search(line.text):
            if named["kind"].upper() != "CARTESIAN":
                what = f"the coordinates are {named['kind'].lower()}, not Cartesian"
                refuse(where, what, "export the points in Cartesian coordinates")
            axes = True
            if inside := _PARENTHESES.findall(_SIGMA.sub("", named["rest"])):
                unit = inside[-1]
                to_metres(unit, where)
        elif (said := _UNIT_LINE.search(line.text)) and _unit_of(said[1]) is not None:
            unit = unit or said[1]
    return unit, axes, coverage


def _delimiter_of(line: str) -> str:
    return next((sign for sign in ";\t" if sign in line), ",")


def _cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line of the table, the empty ones at its end left out."""
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    cells = [cell.strip() for cell in cells]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _header(lines: Sequence[Line], delimiter: str) -> tuple[Line | None, list[str]]:
    """The line that names x, y and z, among the first of the file or a comment; its names."""
    data = [line for line in lines if not line.comment][:_PREAMBLE]
    comments = [line for line in lines if line.comment and "=" not in line.text]
    wanted = {("coordinate", axis) for axis in "xyz"}
    for line in (*data, *comments):
        # SpatialAnalyzer's comment may be delimited otherwise than the rows, and a name bracketed
        # as optional, alone or with its neighbours: `[U-x`, `U-z]`.
        own = _delimiter_of(line.text) if line.comment else delimiter
        names = [name.removeprefix("[") for name in _cells_of(_SIGMA.sub("", line.text), own)]
        names = [n[:-1] if n.endswith("]") and n.count("]") > n.count("[") else n for n in names]
        if wanted <= {named[:2] for named in map(_named, names) if named}:
            return line, names
    return None, []


def _columns(names: Sequence[str], where: str) -> dict[str, Any]:
    """What a header's cells say of a table; DataError where they do not make one of points."""
    units, kinds = dict[int, str | None](), {kind: dict[str, int]() for kind in _COLUMN}
    for i, name in enumerate(names):
        if (named := _named(name)) is not None:
            kind, axis, units[i] = named
            if kinds[kind].setdefault(axis, i) != i:
                refuse(where, f"names the column `{name}` twice", "leave one out")
    uncertain = kinds["expanded"] or kinds["standard"]
    if kinds["expanded"] and kinds["standard"]:
        refuse(where, "has both U(95) and u columns", "leave one kind of them out")
    if uncertain and set(uncertain) != set("xyz"):
        stated = ", ".join(sorted(uncertain))
        refuse(where, f"has uncertainties for {stated} only", "give them for all three, or none")
    folded = [name.lower() for name in names]
    point, target, group = (
        next((folded.index(name) for name in known if name in folded), None)
        for known in (_POINT, _TARGET, _GROUP)
    )
    roles = ["offset" if i not in units and _OFFSET.search(n) else "" for i, n in enumerate(names)]
    own: dict[str, int | None] = {"group": group, "point": target if point is None else point}
    own |= kinds["coordinate"] | {f"u{axis}": i for axis, i in uncertain.items()}
    for role, index in own.items():
        if index is not None:
            roles[index] = role
    return {
        "names": names,
        "roles": roles,
        "units": {role: unit for i, role in enumerate(roles) if role and (unit := units.get(i))},
        "expanded": bool(kinds["expanded"]),
        "bare": any(re.match(r"U\W", names[i]) for i in kinds["standard"].values()),
        "reflector": point is None and target is not None and group is None,
    }


def _named(name: str) -> tuple[str, str, str | None] | None:
    """Kind, axis x, y or z, and unit as written, of a column's name."""
    for kind, pattern in _COLUMN.items():
        if found := pattern.fullmatch(name.strip()):
            return kind, found["axis"].lower(), found["unit"] or found["bare"]
    return None
