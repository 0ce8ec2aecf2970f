"""Rows of a text log: parsed fast as they should be, or line by line where something is wrong."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.files.yaml import shorten
from tdfscal.logs.date_times import DATES, seconds_of, seconds_of_all
from tdfscal.logs.log_file import placed
from tdfscal.logs.text.cells import advice, number_in, split_cells, split_label
from tdfscal.logs.text.head import END, ragged
from tdfscal.logs.text.header import Header
from tdfscal.records import FloatArray

_PARSER_BLOCK = 1 << 20  # stays in the cache
_RUN = re.compile(rb"[ \t]{2,}|\t|(?m:^ | (?=\r?$))")
_OUTER = re.compile(rb"(?m)^ | (?=\r?$)")


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of one block.

    value : (C, N), the wanted columns as recorded, in the order of `Header.wanted`; NaN in the
    three columns of a signal that a row of a sparse table leaves out.
    lines : of the block, blank ones too.
    """

    value: FloatArray
    lines: int

    @property
    def count(self) -> int:
        """N."""
        return int(self.value.shape[1])


class RowParser:
    """Parses blocks of whole lines: those wanted of the table's columns."""

    def __init__(self, header: Header, newline: bytes, decimal: str) -> None:
        self._header, self._newline, self._decimal = header, newline, decimal
        names = [str(c) for c in range(header.columns)]
        wanted = [str(c) for c in header.wanted]
        self._read = pa_csv.ReadOptions(
            column_names=names, block_size=_PARSER_BLOCK, use_threads=False
        )
        self._parse = pa_csv.ParseOptions(delimiter=header.separator)
        # Cells without a name are read too, as nothing but empty ones.
        nameless = names[len(header.names) :]
        types = dict.fromkeys(wanted, pa.float64()) | dict.fromkeys(nameless, pa.null())
        if header.zoned is not None:
            types[str(header.time)] = pa.string()
        self._convert = pa_csv.ConvertOptions(
            column_types=types,
            include_columns=[*wanted, *nameless],
            null_values=[""] if nameless or header.sparse else [],
            decimal_point=decimal,
        )

    def fast(self, block: bytes) -> Rows | None:
        """Parse a block of whole lines with pyarrow; None where one might be wrong."""
        lines = block.count(self._newline)
        if block.isspace():
            return Rows(np.empty((len(self._header.wanted), 0)), lines)
        source = single_spaces(block) if self._header.separator == " " else block
        try:
            table = pa_csv.read_csv(pa.BufferReader(source), self._read, self._parse, self._convert)
        except pa.ArrowInvalid:
            return None
        # A quotation mark that is never closed can swallow lines whole.
        whole = lines + (not block.endswith(self._newline))
        if table.num_rows != whole and table.num_rows != sum(1 for _ in self._lines(block, 0)):
            return None
        value = np.empty((len(self._header.wanted), table.num_rows))
        sparse = self._header.sparse
        for k, (column, values) in enumerate(zip(table.columns, value, strict=False)):
            if column.null_count and not (sparse and k < len(value) - 1):
                return None
            begin = 0
            if pa.types.is_string(column.type):
                values[:] = seconds_of_all(column, zoned=bool(self._header.zoned))
                if np.isnan(values).any():
                    return None
                continue
            for chunk in column.chunks:
                values[begin : begin + len(chunk)] = as_numpy(chunk)
                begin += len(chunk)
            # The sum is finite where all are, but for magnitudes that no log has.
            if not np.isfinite(values.sum()) and np.isfinite(values).sum() + column.null_count != (
                values.size
            ):
                return None
        return Rows(value, whole) if not sparse or _whole_signals(value) else None

    def slow(self, block: bytes, first_line: int) -> Rows:
        """Parse a block of whole lines one by one.

        first_line : the number of its first line, from 1. Raises DataError for the first line that
        is wrong.
        """
        kept: list[list[float]] = []
        for number, line in self._lines(block, first_line):
            with placed(f"line {number}"):
                kept.append(self._row(line.decode("utf-8", errors="replace")))
        table = np.array(kept, dtype=np.float64).reshape(len(kept), len(self._header.wanted))
        return Rows(table.T.copy(), block.count(self._newline))

    def _lines(self, block: bytes, first_line: int) -> Iterator[tuple[int, bytes]]:
        """Lines that are not blank, with their numbers."""
        for k, line in enumerate(block.split(self._newline)):
            bare = line.strip(b"\r\n")
            if bare and not (self._header.ends and bare == END):
                yield first_line + k, bare

    def _row(self, line: str) -> list[float]:
        header = self._header
        cells = split_cells(line, header.separator)
        if len(cells) != header.columns:
            same = header.columns == len(header.names)
            raise ragged(len(cells), header.columns, "the header" if same else "the first row")
        if any(cells[len(header.names) :]):
            raise DataError(
                f"{shorten(cells[-1])!r} stands in a column that has no name in the header",
                hint="the other rows end with a separator; record or export the file again",
            )
        wanted = set(header.wanted)
        for three in header.components if header.sparse else ():
            if not any(cells[c] for c in three):
                wanted -= set(three)
        numbers: dict[int, float] = {}
        for c in sorted(wanted):
            dated = header.zoned is not None and c == header.time
            if dated:
                value = seconds_of(cells[c], zoned=header.zoned)
            else:
                value = number_in(cells[c], self._decimal)
            if value is None:
                raise self._fault(cells[c], header.names[c], dated)
            numbers[c] = value
        return [numbers.get(c, np.nan) for c in header.wanted]

    def _fault(self, cell: str, name: str, dated: bool) -> DataError:
        bare, _ = split_label(name)
        what, hint = f"{shorten(cell)!r} is not a finite number", advice(cell, self._decimal)
        if dated:
            what, hint = f"{shorten(cell)!r} is no date and time as the first row has one", DATES
        elif not cell:
            what, hint = "the cell is empty", "a log has no holes"
        # What is written there is no reading; nothing there may be an axis that nobody measures.
        unread = cell.strip().lower() in ("", "nan")
        fields = (name, bare) if unread else ()
        return DataError(what, where=f"column {name}", hint=hint, fields=fields)


def _whole_signals(value: FloatArray) -> bool:
    """Whether each row has all three cells of a signal, or none of them."""
    missing = np.isnan(value[:-1]).reshape(-1, 3, value.shape[1])
    return bool(np.all(missing[:, 0] == missing[:, 1]) and np.all(missing[:, 0] == missing[:, 2]))


def single_spaces(block: bytes) -> bytes:
    """Lines whose cells are apart by single spaces, with none at the ends."""
    return _OUTER.sub(b"", _RUN.sub(b" ", block)) if _RUN.search(block) else block
