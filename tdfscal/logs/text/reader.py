"""Logs as text: CSV, TSV and what recorders make of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_arrow
from tdfscal.logs.log_file import EMPTY, LogFile, mapped
from tdfscal.logs.request import Piece, Request
from tdfscal.logs.table import (
    has_zone,
    is_date_time,
    repeated,
    sampled,
    seconds_of_all,
    table_piece,
)
from tdfscal.logs.text.head import (
    END,
    SEARCHED,
    decimal_of,
    is_number,
    line_above_rows,
    number_in,
    row_cells,
    scope_head,
    split_cells,
    split_label,
    units_below,
)
from tdfscal.logs.text.opening import EXPANDING, TextFile, open_text
from tdfscal.logs.text.rows import RowParser, Rows, find_header, single_spaces

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents

_THREADS: Final = 2
_GLANCE: Final = 1 << 16


class TextLog(LogFile):
    """One text file, plain or compressed."""

    faults = EXPANDING

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the rows of the wanted columns."""
        with open_text(self.path) as file:
            header = find_header(file.lines, request)
            parser = RowParser(header, file.newline, request.mapping.decimal)
            line, rows_before, series = header.lines + 1, 0, request.mapping.rows == "timeseries"

            above, ended = b"", True

            def parsed(given: tuple[bytes, bool]) -> tuple[bytes, bool, Rows | None]:
                return (*given, parser.fast(given[0]))

            with closing(mapped(parsed, file.blocks(header.lines), _THREADS)) as results:
                for block, whole, fast in results:
                    if not (whole or parser.ends_alike(block, above, series)):
                        continue
                    above, ended = block, whole
                    value, lines = fast or parser.slow(block, line)
                    n = len(header.factors)
                    vectors = value[: 3 * n].reshape(n, 3, value.shape[1])
                    time = None if header.time is None else value[-1] * header.time_factor
                    piece = table_piece(
                        request, vectors, header.factors, time, rows_before, sparse=header.sparse
                    )
                    rows_before += value.shape[1]
                    line += lines
                    self.position = file.position
                    yield piece
        if rows_before == 0 and file.cut_at is not None:
            raise DataError(
                "the only row below the header has no end and may be cut short",
                hint="record the log again, or end the line if the row is whole",
            )
        if rows_before == 0:
            raise DataError("the file has a header and no rows", hint=EMPTY)
        self.cut_at = file.cut_at if ended else None
        self.integrity = file.integrity

    def look(self) -> Contents:
        """Its header, found without knowing what is wanted, and some rows of each block."""
        from tdfscal.logs.contents import SAMPLES, table_contents

        with open_text(self.path) as file:
            table = _Table(file)
            parts: list[tuple[int, pa.Table]] = []
            count = 0
            for block, whole in file.blocks(table.skipped):
                end = block.find(file.newline, _GLANCE) + 1 if parts else 0
                parts.append((count, table.parsed(block[: end or None], whole=whole)))
                count += block.count(file.newline) + (not block.endswith(file.newline))
        found = [
            sampled([(row, part.column(k)) for row, part in parts], SAMPLES)
            for k in range(len(table.names))
        ]
        kinds = [
            "empty" if not parts
            else "text" if one is None
            else "date and time" if k in table.dated
            else "number"
            for k, one in enumerate(found)
        ]  # fmt: skip
        twice = repeated(table.names)
        numbers = {
            name: one
            for name, one in zip(table.names, found, strict=True)
            if one is not None and name not in twice
        }
        described = list(zip(table.names, kinds, table.units, strict=True))
        return table_contents(
            self.path, "csv", count, described, numbers,
            decimal=table.decimal, problems=table.problems(),
        )  # fmt: skip


class _Table:
    """A table as it is looked through: its columns, and some of its rows.

    skipped : lines before the first row. dated : columns of dates with times of day. Raises
    DataError where it is no table with a header.
    """

    def __init__(self, file: TextFile) -> None:
        lines = file.lines[: 2 * SEARCHED]
        head = scope_head(lines) or line_above_rows(lines)
        self._separator, cells, self._ends = head.separator, head.cells, head.scope
        self.skipped = head.lines if head.scope else head.line + 1
        rows = [split_cells(line, self._separator) for line in lines[self.skipped :]]
        self.decimal = decimal_of((cell for row in rows for cell in row), self._separator)
        if head.scope:
            stated = [head.units.get(k) for k in range(len(cells))]
        else:
            below = units_below(lines, head)
            self.skipped += below is not None
            stated = [split_label(c)[1] or (below or {}).get(k) for k, c in enumerate(cells)]
        self._width = row_cells(lines[self.skipped :], self._separator, cells)
        self.names = [split_label(cell)[0] for cell in cells[: self._width]]
        self.units = stated[: self._width]
        self.dated: set[int] = set()
        self._pointed: set[str] = set()  # columns of numbers by the other decimal
        self._odd: list[int] = []  # numbers of cells of the lines that have others

    def parsed(self, block: bytes, *, whole: bool) -> pa.Table:
        """Parse whole lines; those with another number of cells are left out, and noted."""

        def leave_out(row: pa_csv.InvalidRow) -> str:
            if whole and not (self._ends and row.text == END.decode()):
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
            pa_csv.ConvertOptions(decimal_point=self.decimal, timestamp_parsers=["never"]),
        )
        for k, column in enumerate(table.columns):
            first = column[0].as_py() if pa.types.is_string(column.type) and len(column) else ""
            if is_number(first, self.decimal):  # a spoilt cell is a hole; the reading names it
                cells = [number_in(cell, self.decimal) for cell in column.to_pylist()]
                if self.decimal == "," and all(cell is None for cell in cells):
                    self._pointed.add(self.names[k])
                table = table.set_column(k, str(k), pa.array(cells, pa.float64()))
            if is_date_time(first):
                seconds = seconds_of_all(column, zoned=has_zone(first))
                if not np.isnan(seconds).any():
                    self.dated.add(k)
                    table = table.set_column(k, str(k), [as_arrow(seconds)])
        return table

    def problems(self) -> list[str]:
        """What is wrong with columns that are not read and with the lines that were left out."""
        pointed = [
            f"{name} has numbers with a point, and the decimal of this file is a comma: they are "
            "not read; export them alike"
            for name in sorted(self._pointed)
        ]
        if not self._odd:
            return pointed
        found = ", ".join(str(n) for n in sorted(set(self._odd))[:3])
        found += " cell" if found == "1" else " cells"
        many = "a line has" if len(self._odd) == 1 else f"{len(self._odd)} lines have"
        return [
            *pointed,
            f"{many} {found} where a row has {self._width}; the file may be damaged there: "
            "record or export it again",
        ]
