"""Contents of a text log: its header found without knowing what is wanted."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.csv as pa_csv

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_arrow
from tdfscal.logs.common import units
from tdfscal.logs.common.contents import SAMPLES, Contents
from tdfscal.logs.common.damage import damage
from tdfscal.logs.common.table import repeated, sampled, table_contents
from tdfscal.logs.text.cells import fits_header, header_cells, row_cells, split_cells, split_label
from tdfscal.logs.text.date_times import has_zone, is_date_time, seconds_of_all
from tdfscal.logs.text.file import EXPANDING, TextFile, open_text
from tdfscal.logs.text.header import SEPARATORS, Candidate, numbered_columns
from tdfscal.logs.text.numbers import decimal_of, is_number
from tdfscal.logs.text.rows import ragged, single_spaces
from tdfscal.logs.text.scope import scope_table

_SEARCHED: Final = 64
_GLANCE: Final = 1 << 16
_OPENING: Final = 1 << 20


def text_contents(path: Path, *, opening: bool) -> Contents:
    """Look through a CSV or TSV file, or its opening: header and some rows of each block."""
    with damage(path, *EXPANDING), open_text(path) as file:
        look = TextLook(file)
        for block, whole in file.blocks(look.skipped):
            if opening:
                end = block.find(file.newline, _OPENING) + 1
                look.note(block[: end or None], whole=whole)
                break
            look.note(block, whole=whole)
        return look.contents(path)


class TextLook:
    """What a text log holds, noted while its blocks pass.

    skipped : lines before the first row. Raises DataError where it is no table with a header.
    """

    def __init__(self, file: TextFile) -> None:
        self._newline = file.newline
        lines = file.lines[: 2 * _SEARCHED]
        scope = scope_table(lines[:_SEARCHED])
        cells: tuple[str, ...]
        if scope is not None:
            self._separator, self.skipped, cells = scope.separator, scope.lines, scope.names
            stated = [scope.units.get(k) for k in range(len(cells))]
        else:
            head = _header(lines)
            self._separator, self.skipped, cells = head.separator, head.line + 1, head.cells
            stated = [split_label(cell)[1] for cell in cells]
        rows = [split_cells(line, self._separator) for line in lines[self.skipped :]]
        self._decimal = decimal_of((cell for row in rows for cell in row), self._separator)
        if scope is None and rows:
            row = [cell.strip("[]() ") for cell in rows[0]]
            if fits_header(row, cells) and not any(is_number(c, self._decimal) for c in row):
                self.skipped += 1
                below = [cell if units.is_unit(cell) else None for cell in row]
                below += [None] * (len(cells) - len(row))
                stated = [one or other for one, other in zip(stated, below, strict=False)]
        self._width = row_cells(lines[self.skipped :], self._separator, cells)
        self._names = [split_label(cell)[0] for cell in cells[: self._width]]
        self._stated = stated[: self._width]
        self._parts: list[tuple[int, pa.Table]] = []
        self._count = 0
        self._odd: list[int] = []  # numbers of cells of the lines that have others
        self._dated: set[int] = set()

    def note(self, block: bytes, *, whole: bool) -> None:
        """Take in the next block; whole : its last line has an end."""
        end = block.find(self._newline, _GLANCE) + 1 if self._parts else 0
        self._parts.append((self._count, self._parsed(block[: end or None], whole=whole)))
        self._count += block.count(self._newline) + (not block.endswith(self._newline))

    def _parsed(self, block: bytes, *, whole: bool) -> pa.Table:
        """Parse whole lines; those with another number of cells are left out, and noted."""

        def leave_out(row: pa_csv.InvalidRow) -> str:
            if whole:
                self._odd.append(row.actual_columns)
            return "skip"

        if self._separator == " ":
            block = single_spaces(block)
        table = pa_csv.read_csv(
            pa.BufferReader(block),
            pa_csv.ReadOptions(
                column_names=[str(k) for k in range(self._width)],
                # At once, so that no line is longer than what is parsed at a time.
                block_size=len(block) + 1,
                # Lines that are left out are decoded, and Latin-1 decodes whatever there is.
                encoding="utf8" if block.isascii() else "latin1",
                # Its threads would call the handler, and have ended the process over long lines.
                use_threads=False,
            ),
            pa_csv.ParseOptions(delimiter=self._separator, invalid_row_handler=leave_out),
            # Dates as text: one reader of them, for all notations.
            pa_csv.ConvertOptions(decimal_point=self._decimal, timestamp_parsers=["never"]),
        )
        for k, column in enumerate(table.columns):
            if not (pa.types.is_string(column.type) and len(column)):
                continue
            first = column[0].as_py()
            if not is_date_time(first):
                continue
            if (seconds := seconds_of_all(column, zoned=has_zone(first))) is not None:
                self._dated.add(k)
                table = table.set_column(k, str(k), [as_arrow(seconds)])
        return table

    def contents(self, path: Path) -> Contents:
        """What was there."""
        columns = [
            [(row, part.column(k)) for row, part in self._parts] for k in range(len(self._names))
        ]
        found = [sampled(parts, SAMPLES) for parts in columns]
        kinds = [
            "empty" if not self._parts
            else "text" if one is None
            else "date and time" if k in self._dated
            else "number"
            for k, one in enumerate(found)
        ]  # fmt: skip
        twice = repeated(self._names)
        numbers = {
            name: one
            for name, one in zip(self._names, found, strict=True)
            if one is not None and name not in twice
        }
        described = list(zip(self._names, kinds, self._stated, strict=True))
        return table_contents(
            path, "csv", self._count, described, numbers,
            decimal=self._decimal, problems=self._problems(),
        )  # fmt: skip

    def _problems(self) -> list[str]:
        if not self._odd:
            return []
        found = ", ".join(str(n) for n in sorted(set(self._odd))[:3])
        found += " cell" if found == "1" else " cells"
        many = "a line has" if len(self._odd) == 1 else f"{len(self._odd)} lines have"
        return [
            f"{many} {found} where a row has {self._width}; the file may be damaged there: "
            "record or export it again"
        ]


def _header(lines: list[str]) -> Candidate:
    """The first line of names above most lines."""
    best: Candidate | None = None
    widest = 0
    fault: DataError | None = None
    for separator in SEPARATORS:
        if separator == " " and best is not None:
            continue  # spaces stand within names, too
        split = [split_cells(line, separator) for line in lines[:_SEARCHED]]
        widths = [len(cells) for cells in split if len(cells) > 1]
        if not widths:
            continue
        width = max(set(widths), key=widths.count)
        number = next(k for k, cells in enumerate(split) if len(cells) == width)
        if _has_number(split[number]):
            # Recorders end their rows with a separator, or the header, and the other not.
            number -= 1
            above = header_cells(lines[number], separator) if number >= 0 else []
            if abs(len(above) - width) > 1 or _has_number(above):
                continue
            if not fits_header(split[number + 1], above):
                where = f"line {number + 2}"
                fault = fault or ragged(width, len(above)).restated(where=where)
                continue
        # Commas within numbers make columns too; the header has none of them then.
        if width > widest:
            widest = width
            best = Candidate(number, separator, tuple(header_cells(lines[number], separator)))
    if best is None and fault is not None:
        raise fault
    for decimal in ".,":
        numbered = numbered_columns(lines, decimal)
        if numbered is not None and len(numbered.cells) > widest:
            return numbered
    if best is None:
        raise DataError(
            "there is no table of numbers",
            hint="export the recording as a table, with the columns' names in the first line",
        )
    return best


def _has_number(cells: list[str]) -> bool:
    return any(is_number(c, d) for c in cells for d in ".,")
