"""Logs as text: CSV, TSV and what recorders make of them, plain or compressed, block by block.

A block is parsed at once; line by line where something in it might be wrong.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import zstandard

from tdfscal.errors import DataError
from tdfscal.files.yaml import shorten
from tdfscal.logs.log_file import EMPTY, LogFile, Piece, Request, mapped, placed
from tdfscal.logs.table import DATES, Wanted, seconds_of, table_piece
from tdfscal.logs.text_file import TextFile
from tdfscal.logs.text_table import (
    SEARCHED,
    Table,
    find_columns,
    find_table,
    is_number,
    ragged,
    split_cells,
    split_label,
)
from tdfscal.records import FloatArray

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents

Decimal = Literal[".", ","]
Values = tuple[FloatArray, FloatArray | None]
"""Signals (signals, 3, N), SI, and the time (N,), s."""

_THREADS: Final = 2
_GLANCE: Final = 1 << 16
_PARSER_BLOCK: Final = 1 << 20  # stays in the cache
#: Lines that are wrong of which a message has the numbers; and after which none is looked for.
_LISTED: Final = 4
_WRONG: Final = 100
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_RUN = re.compile(rb"[ \t]{2,}|\t|(?m:^ | (?=\r?$))")
_OUTER = re.compile(rb"(?m)^ | (?=\r?$)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_SWAPPED: Final = str.maketrans(".,", ",.")
_UNREAD: Final = ("", "nan")
"""What is written where there was no reading."""


class TextLog(LogFile):
    """One text file, plain or compressed."""

    faults = (pa.ArrowException, zlib.error, zstandard.ZstdError)

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the rows of the wanted columns."""
        with self.path.open("rb") as raw:
            file = TextFile(raw)
            table, wanted = find_columns(file.lines, request)
            parser = RowParser(table, wanted, file.newline, request.mapping.decimal)
            line, row, series = table.lines + 1, 0, request.mapping.rows == "timeseries"
            above, ended, wrong = b"", True, dict[int, DataError]()

            def parsed(given: tuple[bytes, bool]) -> tuple[bytes, bool, int, Values | None]:
                count = parser.count(given[0])
                return (*given, count, parser.fast(given[0], count))

            with closing(mapped(parsed, file.blocks(table.lines), _THREADS)) as results:
                for block, whole, count, values in results:
                    if not (whole or parser.ends_alike(block, above, series)):
                        continue
                    above, ended = block, whole
                    vectors, time = parser.slow(block, line, wrong) if values is None else values
                    if not wrong:
                        yield table_piece(request, vectors, time, row, sparse=wanted.sparse)
                    row += vectors.shape[2]
                    line += count
                    if len(wrong) > _WRONG:
                        break
        if wrong:
            raise _all_of(wrong)
        if row == 0 and file.cut_at is not None:
            raise DataError(
                "the only row below the header has no end and may be cut short",
                hint="record the log again, or end the line if the row is whole",
            )
        if row == 0:
            raise DataError("the file has a header and no rows", hint=EMPTY)
        self.cut_at = file.cut_at if ended else None
        self.integrity = file.integrity

    def look(self) -> Contents:
        """Its columns, and some rows of each block."""
        from tdfscal.logs.contents import table_contents  # not needed to read it

        with self.path.open("rb") as raw:
            file = TextFile(raw)
            lines = file.lines[: 2 * SEARCHED]
            table = find_table(lines)
            labels = table.labels()[: table.width]
            cells = (c for line in lines[table.lines :] for c in split_cells(line, table.separator))
            comma = table.separator != "," and any(map(_WITH_COMMA.fullmatch, cells))
            decimal: Decimal = "," if comma else "."
            parts, count = list[tuple[int, pa.Table]](), 0
            for block, _ in file.blocks(table.lines):
                end = block.find(file.newline, _GLANCE) + 1 if count else 0
                part = block[: end or None]
                parts.append((count, _looked_at(part, table.separator, table.width, decimal)))
                count += block.count(file.newline) + (not block.endswith(file.newline))
        columns = [(str(k), name, None, unit) for k, (name, unit) in enumerate(labels)]
        return table_contents(self.path, "csv", count, parts, columns, decimal)


def _looked_at(block: bytes, separator: str, width: int, decimal: Decimal) -> pa.Table:
    """Some whole lines without knowing what is wanted; those with other cells are left out."""
    table = pa_csv.read_csv(
        pa.BufferReader(_single_spaces(block) if separator == " " else block),
        pa_csv.ReadOptions(
            column_names=[str(k) for k in range(width)],
            # At once, so that no line is longer than what is parsed at a time.
            block_size=len(block) + 1,
            # Lines that are left out are decoded, and Latin-1 decodes whatever there is.
            encoding="utf8" if block.isascii() else "latin1",
            # Its threads would call the handler, and have ended the process over long lines.
            use_threads=False,
        ),
        pa_csv.ParseOptions(delimiter=separator, invalid_row_handler=lambda row: "skip"),
        # Dates as text: one reader of them, for all notations.
        pa_csv.ConvertOptions(decimal_point=decimal, timestamp_parsers=["never"]),
    )
    for k, column in enumerate(table.columns):
        first = column[0].as_py() if pa.types.is_string(column.type) and len(column) else ""
        if is_number(first):  # a spoilt cell is a hole; the reading names it
            # With the other decimal too: reading the column says what is wrong.
            both = ([_number(cell, d) for d in (decimal, ".")] for cell in column.to_pylist())
            numbers = [other if own is None else own for own, other in both]
            table = table.set_column(k, str(k), pa.array(numbers, pa.float64()))
    return table


class RowParser:
    """Parses blocks of whole lines: the wanted signals and the time, as `Wanted` has them."""

    def __init__(self, table: Table, wanted: Wanted, newline: bytes, decimal: str) -> None:
        self._table, self._wanted, self._newline, self._decimal = table, wanted, newline, decimal
        self._time = None if wanted.time is None else int(wanted.time)
        #: x, y, z of each signal, then the time.
        self._columns = [int(name) for three, _ in wanted.signals for name in three]
        self._columns += [] if self._time is None else [self._time]
        names = [str(c) for c in range(table.width)]
        self._read = pa_csv.ReadOptions(
            column_names=names, block_size=_PARSER_BLOCK, use_threads=False
        )
        self._parse = pa_csv.ParseOptions(delimiter=table.separator)
        # Cells without a name are read too, as nothing but empty ones.
        nameless = names[len(table.names) :]
        types = dict.fromkeys(map(str, self._columns), pa.float64())
        types |= dict.fromkeys(nameless, pa.null())
        if wanted.zoned is not None:
            types[str(wanted.time)] = pa.string()
        self._convert = pa_csv.ConvertOptions(
            column_types=types,
            include_columns=list(types),
            null_values=[""] if nameless or wanted.sparse else [],
            decimal_point=decimal,
        )

    def count(self, block: bytes) -> int:
        """Ends of lines in a block."""
        return int(np.count_nonzero(np.frombuffer(block, np.uint8) == self._newline[0]))

    def fast(self, block: bytes, lines: int) -> Values | None:
        """Parse a block with pyarrow; None where something might be wrong. lines : its ends."""
        if block.isspace():
            return self._scaled(np.empty((0, len(self._columns))))
        source = _single_spaces(block) if self._table.separator == " " else block
        try:
            table = pa_csv.read_csv(pa.BufferReader(source), self._read, self._parse, self._convert)
            values = self._wanted.values(table)
        except (pa.ArrowInvalid, DataError):
            return None
        # A quotation mark that is never closed can swallow lines whole.
        whole = lines + (not block.endswith(self._newline))
        if table.num_rows != whole and table.num_rows != sum(1 for _ in self._lines(block, 0)):
            return None
        return values

    def slow(self, block: bytes, first_line: int, wrong: dict[int, DataError]) -> Values:
        """Parse a block line by line.

        first_line : the number of its first line, from 1. wrong : takes the lines that are. Raises
        DataError for a column in which all are.
        """
        kept: list[list[float]] = []
        rows = [(number, self._cells(line)) for number, line in self._lines(block, first_line)]
        begins = first_line == self._table.lines + 1

        def never(c: int) -> bool:
            return begins and all(row[c].lower() in _UNREAD for _, row in rows if c < len(row))

        for number, cells in rows:
            try:
                with placed(f"line {number}"):
                    kept.append(self._row(cells, never))
            except DataError as error:
                if error.fields:
                    raise
                wrong[number] = error
        return self._scaled(np.array(kept, dtype=np.float64).reshape(-1, len(self._columns)))

    def _scaled(self, numbers: FloatArray) -> Values:
        """The values of rows (N, columns)."""
        time = None if self._time is None else numbers[:, -1] * self._wanted.second
        factors = np.array([factors for _, factors in self._wanted.signals])
        vectors = numbers[:, : factors.size].T.reshape(*factors.shape, -1)
        return vectors * factors[:, :, None], time

    def ends_alike(self, line: bytes, above: bytes, series: bool) -> bool:
        """Whether a last line without an end is whole: its last number is as long as those above.

        above : whole lines before it. Of decimals it has as many as three of four have, of a
        posture's, which may be rounded, as the shortest; of whole numbers all have its length.
        """
        before = above.rstrip()[-_GLANCE:].split(self._newline)[len(above) > _GLANCE :]
        cells = [self._cells(one.strip()) for one in (line, *before) if one.strip()]
        if len(cells[0]) != self._table.width or cells[0][-1].endswith(self._decimal):
            return False
        last, *others = [len(own[-1].partition(self._decimal)[2]) for own in cells]
        if not any(others) and len(others) > 0 and series:
            return len({len(own[-1]) for own in cells}) == 1
        return last >= (sorted(others)[len(others) // 4 * series] if others else series)

    def _lines(self, block: bytes, first_line: int) -> Iterator[tuple[int, bytes]]:
        """Lines that are not blank, with their numbers."""
        for k, line in enumerate(block.split(self._newline)):
            if bare := line.strip(b"\r\n"):
                yield first_line + k, bare

    def _cells(self, line: bytes) -> list[str]:
        return split_cells(line.decode("utf-8", errors="replace"), self._table.separator)

    def _row(self, cells: list[str], never: Callable[[int], bool]) -> list[float]:
        """The wanted numbers of a row; never : whether no row has one in a column."""
        names, width, wanted = self._table.names, self._table.width, self._wanted
        if len(cells) != width:
            above = "the header" if width == len(names) else "the first row"
            raise ragged(len(cells), width, above)
        if any(cells[len(names) :]):
            raise DataError(
                f"{shorten(cells[-1])!r} stands in a column that has no name in the header",
                hint="the other rows end with a separator; record or export the file again",
            )
        numbers = [np.nan] * len(self._columns)
        for c, k in sorted((c, k) for k, c in enumerate(self._columns)):
            three = self._columns[k - k % 3 : k - k % 3 + 3]
            if wanted.sparse and c != self._time and not any(cells[own] for own in three):
                continue
            if wanted.zoned is not None and c == self._time:
                value = seconds_of(cells[c], zoned=wanted.zoned)
            else:
                value = _number(cells[c], self._decimal)
            if value is None:
                raise self._fault(cells[c], c, never=never(c))
            numbers[k] = value
        return numbers

    def _fault(self, cell: str, column: int, *, never: bool) -> DataError:
        """The error for a cell that holds no number; never : nor does one of that column."""
        name = self._table.names[column]
        bare, _ = split_label(name)
        what, hint = f"{shorten(cell)!r} is not a finite number", _advice(cell, self._decimal)
        if bare and cell.strip() in (name, bare):
            what = "the header stands there again: the recorder was started anew"
            hint = "split the file there; where its clock began anew, that is another campaign"
        elif self._wanted.zoned is not None and column == self._time:
            what, hint = f"{shorten(cell)!r} is no date and time as the first row has one", DATES
        elif never:  # it may be an axis that nobody measures
            what, hint = "no cell of the column holds a number", "record it, or name another"
        elif not cell:
            what, hint = "the cell is empty", "correct that cell, or leave its row out"
        fields = (name, bare) if never else ()
        return DataError(what, where=f"column {name}", hint=hint, fields=fields)


def _all_of(wrong: dict[int, DataError]) -> DataError:
    """The first of wrong lines, with the numbers of the next and how many they are."""
    (_, first), *others = wrong.items()
    if not others:
        return first
    lines = ", ".join(str(line) for line, _ in others[:_LISTED])
    more = f" and {len(others) - _LISTED} others" if len(others) > _LISTED else ""
    least = "at least " if len(wrong) > _WRONG else ""
    said = f"lines {lines}{more} are wrong too, {least}{len(wrong)} in all"
    return first.restated(what=f"{first.what}; {said}")


def _number(cell: str, decimal: str) -> float | None:
    """Return the finite number that a cell holds; None where it holds none."""
    plain = cell.translate(_SWAPPED) if decimal == "," else cell
    if _NUMBER.fullmatch(plain) and math.isfinite(value := float(plain)):
        return value
    return None


def _advice(cell: str, decimal: str) -> str:
    """Say what to do about a cell that holds no finite number."""
    swapped = cell.replace(",", ".") if decimal == "." else cell
    if swapped != cell and _NUMBER.fullmatch(swapped):
        return 'state `decimal: ","` in the log block of rig.yaml if the comma is the decimal'
    if decimal == "," and _NUMBER.fullmatch(cell):
        return 'the mapping says `decimal: ","`; take it out if the point is the decimal'
    return "each cell must be a finite number: correct it, or leave its row out"


def _single_spaces(block: bytes) -> bytes:
    """Lines whose cells are apart by single spaces, with none at the ends."""
    return _OUTER.sub(b"", _RUN.sub(b" ", block)) if _RUN.search(block) else block
