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
    is_column_name,
    is_header,
    last_digit,
    read_header,
    refuse,
    spatial_analyzer,
    to_metres,
    unit_of,
)
from tdfscal.files.yaml import unreadable
from tdfscal.findings import Finding, Value
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
    "begin the file with a line that names each column, such as `group,point,x,y,z`; a column that "
    "is not used may have any name"
)
_CELL = re.compile(r'"([^"]*)"|(\S+)')
_DECIMAL_COMMAS = re.compile(r"[^,]*(?:(?<=\d),(?=\d)[^,]*)+")


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
            if inside := _PARENTHESES.findall(_without_coverage(named["rest"])):
                unit = inside[-1]
                to_metres(unit, where)
        elif (stated := _UNIT_LINE.search(line.text)) and unit_of(stated[1]) is not None:
            unit = unit or stated[1]
    uncertain = any(_UNCERTAIN.search(line.text) for line in lines)
    return Preamble(unit, axes, coverage, uncertain)


def _without_coverage(text: str) -> str:
    """A header's text without "(1.0 sigma)", which is no unit."""
    return _SIGMA.sub("", text)


def _delimiter_of(line: str) -> str | None:
    """The separator of a data line; None for white space."""
    if ";" in line:
        return ";"
    if "\t" in line:
        return "\t"
    if "," not in line or (len(line.split()) >= 3 and _DECIMAL_COMMAS.fullmatch(line)):
        return None
    return ","


def _cells_of(line: str, delimiter: str | None) -> list[str]:
    """Cells of a line of the table, the empty ones at its end left out."""
    if delimiter is None:
        return [quoted or plain for quoted, plain in _CELL.findall(line)]
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    cells = [cell.strip() for cell in cells]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _header_cells(line: str, delimiter: str | None) -> list[str]:
    """Names of the columns; between blanks, `X [mm]` and `Point ID` are one name each."""
    text = _without_coverage(line)
    if delimiter is not None:
        return _cells_of(text, delimiter)
    words, names = _cells_of(text, None), list[str]()
    while words:
        count = next(n for n in (4, 3, 2, 1) if n == 1 or is_column_name(" ".join(words[:n])))
        names.append(" ".join(words[:count]))
        words = words[count:]
    return names


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


def read_table(text: str, source: str) -> tuple[Table, Preamble]:
    """The table, and what the lines beside it say."""
    lines = _split(text)
    data = [line for line in lines if not line.comment]
    delimiter = _delimiter_of(data[-1].text) if data else None
    header = _header(lines, delimiter)
    begin = 0 if header is None or header.comment else header.number
    body = [line for line in data if line.number > begin]
    if not body:
        what = "holds a header, but no points" if data else "holds no points"
        refuse(source, what, "check the export")
    others = [line for line in lines if line.comment or line.number <= begin]
    beside = _read_preamble(others, source)
    rows, comma = [_cells_of(line.text, delimiter) for line in body], delimiter != ","
    if header is not None:
        where = f"{source}, line {header.number}"
        columns = read_header(_cells_of_header(header, delimiter), where)
    elif beside.axes and (known := spatial_analyzer(len(rows[0]), beside.uncertain)):
        columns = known
    else:
        what = "no line names the columns; the first reads"
        where, shown = f"{source}, line {body[0].number}", ", ".join(rows[0])[:60]
        refuse(where, f"{what} {visible(shown)}", _HEAD)
    table = Table(columns, body, rows, comma, source)
    for k, cells in enumerate(rows):
        expected = len(columns.roles)
        if not columns.needed <= len(cells) <= expected:
            table.refuse(
                k,
                f"has {len(cells)} columns where {expected} are expected",
                "check the line; quote a name that has a comma or a blank in it",
            )
        cells += [""] * (expected - len(cells))
    return table, beside


def _header(lines: Sequence[Line], delimiter: str | None) -> Line | None:
    """The line that names x, y and z: among the first of the file, or a comment."""
    data = [line for line in lines if not line.comment][:_PREAMBLE]
    comments = [line for line in lines if line.comment and "=" not in line.text]
    named = (line for line in (*data, *comments) if is_header(_cells_of_header(line, delimiter)))
    return next(named, None)


def _cells_of_header(line: Line, delimiter: str | None) -> list[str]:
    """Names of the columns; SpatialAnalyzer's comment may be delimited otherwise than the rows."""
    return _header_cells(line.text, _delimiter_of(line.text) if line.comment else delimiter)


def found_in(code: str, source: str, **values: Value) -> Finding:
    """Return a finding about a point file."""
    return Finding(code, (source,), values=values)
