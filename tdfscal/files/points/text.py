"""The text of a point file: its lines, what the lines before the table say, and cells."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tdfscal.errors import DataError
from tdfscal.files.points.columns import is_column_name, refuse, to_metres, unit_of
from tdfscal.files.yaml import unreadable

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
_CELL = re.compile(r'"([^"]*)"|(\S+)')
_DECIMAL_COMMAS = re.compile(r"[^,]*(?:(?<=\d),(?=\d)[^,]*)+")


@dataclass(frozen=True, slots=True)
class Line:
    """A line that is not blank, without the mark of a comment: its number in the file, its text."""

    number: int
    text: str
    comment: bool = False


@dataclass(frozen=True, slots=True)
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


def split(text: str) -> list[Line]:
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


def read_preamble(lines: Sequence[Line], source: str) -> Preamble:
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
            if inside := _PARENTHESES.findall(without_coverage(named["rest"])):
                unit = inside[-1]
                to_metres(unit, where)
        elif (stated := _UNIT_LINE.search(line.text)) and unit_of(stated[1]) is not None:
            unit = unit or stated[1]
    uncertain = any(_UNCERTAIN.search(line.text) for line in lines)
    return Preamble(unit, axes, coverage, uncertain)


def without_coverage(text: str) -> str:
    """A header's text without "(1.0 sigma)", which is no unit."""
    return _SIGMA.sub("", text)


def delimiter_of(line: str) -> str | None:
    """The separator of a data line; None for white space."""
    if ";" in line:
        return ";"
    if "\t" in line:
        return "\t"
    if "," not in line or (len(line.split()) >= 3 and _DECIMAL_COMMAS.fullmatch(line)):
        return None
    return ","


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Cells of a line of the table, the empty ones at its end left out."""
    if delimiter is None:
        return [quoted or plain for quoted, plain in _CELL.findall(line)]
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    cells = [cell.strip() for cell in cells]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def header_cells(line: str, delimiter: str | None) -> list[str]:
    """Names of the columns; between blanks, `X [mm]` and `Point ID` are one name each."""
    text = without_coverage(line)
    if delimiter is not None:
        return cells_of(text, delimiter)
    words, names = cells_of(text, None), list[str]()
    while words:
        count = next(n for n in (4, 3, 2, 1) if n == 1 or is_column_name(" ".join(words[:n])))
        names.append(" ".join(words[:count]))
        words = words[count:]
    return names
