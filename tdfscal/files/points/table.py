"""The table in a point file's text: its lines, what the lines beside it say, its cells."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from tdfscal.errors import DataError, visible
from tdfscal.files.points.columns import (
    Columns,
    as_number,
    is_header,
    last_digit,
    read_header,
    refuse,
    spatial_analyzer,
    to_metres,
    unit_of,
)
from tdfscal.files.yaml import unreadable
from tdfscal.frozen import record
from tdfscal.records import FloatArray

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
_UNCERTAIN = re.compile(r"uncertaint|\bsigma\b|\bu[-_ ]?[xyz]\b", re.IGNORECASE)
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
class Preamble:
    """What lines beside the table say.

    unit : of length, None where none is named. axes : there is an AXES line of SpatialAnalyzer's.
    coverage : k of the uncertainties, None where none is named. uncertain : they speak of some.
    """

    unit: str | None
    axes: bool
    coverage: float | None
    uncertain: bool


@record
class Table:
    """A table of cells: its columns, the line of each row, decimal comma allowed or not."""

    columns: Columns
    lines: Sequence[Line]
    rows: Sequence[list[str]]
    comma: bool
    source: str

    def refuse(self, row: int, what: str, hint: str) -> NoReturn:
        """Raise DataError at a row."""
        refuse(f"{self.source}, line {self.lines[row].number}", what, hint)

    def numbers(self, columns: Sequence[int], *, blank: bool = False) -> FloatArray:
        """Return the numbers (N, columns); blank : a cell may be, and is not a number then."""
        numbers = np.full((len(self.rows), len(columns)), np.nan)
        for k, row in enumerate(self.rows):
            for j, column in enumerate(columns):
                value = as_number(row[column], comma=self.comma)
                if value is not None:
                    numbers[k, j] = value
                elif row[column] or not blank:
                    self.refuse(k, f"`{row[column]}` is not a finite number", "check the line")
        return numbers

    def texts(self, role: str) -> list[str]:
        """Return the cells of the column of a role; none where there is no such column."""
        return [row[i] for i in self.columns.of(role) for row in self.rows]

    def last_digit(self, columns: Sequence[int]) -> float:
        """Return what the last digit of the most finely written number is worth."""
        return last_digit((row[i] for row in self.rows for i in columns), comma=self.comma)


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


def read_table(text: str, source: str) -> tuple[Table, Preamble]:
    """The table, and what the lines beside it say."""
    lines = _split(text)
    data = [line for line in lines if not line.comment]
    delimiter = _delimiter_of(data[-1].text) if data else ","
    header = _header(lines, delimiter)
    begin = 0 if header is None or header.comment else header.number
    body = [line for line in data if line.number > begin]
    if not body:
        what = "holds a header, but no points" if data else "holds no points"
        refuse(source, what, "check the export")
    beside = _read_preamble([x for x in lines if x.comment or x.number <= begin], source)
    rows = [_cells_of(line.text, delimiter) for line in body]
    if header is not None:
        where = f"{source}, line {header.number}"
        columns = read_header(_header_cells(header, delimiter), where)
    elif beside.axes and (known := spatial_analyzer(len(rows[0]), beside.uncertain)):
        columns = known
    else:
        where, shown = f"{source}, line {body[0].number}", ", ".join(rows[0])[:60]
        refuse(where, f"no line names the columns; the first reads {visible(shown)}", _HEAD)
    table = Table(columns, body, rows, delimiter != ",", source)
    for k, cells in enumerate(rows):
        expected = len(columns.roles)
        if not columns.needed <= len(cells) <= expected:
            what = f"has {len(cells)} columns where {expected} are expected"
            table.refuse(k, what, "check the line; quote a name that has a comma in it")
        cells += [""] * (expected - len(cells))
    return table, beside


def _split(text: str) -> list[Line]:
    """Lines with something in them; those that begin with // or # are comments."""
    lines = []
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        comment = line.startswith(("//", "#")) and not re.match(r"#\s*[;,\t]", line)
        if comment:
            lines.append(Line(number, line.lstrip("/#").strip(), comment=True))
        elif line.strip(',;\t "'):
            lines.append(Line(number, line))
    return lines


def _read_preamble(lines: Sequence[Line], source: str) -> Preamble:
    """Gather what these lines say; DataError where they contradict or name other axes."""
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
        elif (stated := _UNIT_LINE.search(line.text)) and unit_of(stated[1]) is not None:
            unit = unit or stated[1]
    uncertain = any(_UNCERTAIN.search(line.text) for line in lines)
    return Preamble(unit, axes, coverage, uncertain)


def _delimiter_of(line: str) -> str:
    return next((sign for sign in ";\t" if sign in line), ",")


def _cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line of the table, the empty ones at its end left out."""
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    cells = [cell.strip() for cell in cells]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _header(lines: Sequence[Line], delimiter: str) -> Line | None:
    """The line that names x, y and z: among the first of the file, or a comment."""
    data = [line for line in lines if not line.comment][:_PREAMBLE]
    comments = [line for line in lines if line.comment and "=" not in line.text]
    named = (line for line in (*data, *comments) if is_header(_header_cells(line, delimiter)))
    return next(named, None)


def _header_cells(line: Line, delimiter: str) -> list[str]:
    """Names of the columns; SpatialAnalyzer's comment may be delimited otherwise than the rows."""
    own = _delimiter_of(line.text) if line.comment else delimiter
    return _cells_of(_SIGMA.sub("", line.text), own)
