"""The wanted columns of a text log, in which units, and its rows: parsed fast, or line by line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.files.rig.recorders import UNITS, Dimension, by_scale, canonical, unit_factor
from tdfscal.files.yaml import shorten
from tdfscal.frozen import record
from tdfscal.logs.log_file import Request, Signal, placed
from tdfscal.logs.table import (
    DATES,
    columns_of,
    has_zone,
    is_date_time,
    seconds_of,
    seconds_of_all,
    takes_turns,
)
from tdfscal.logs.text.header import Table, find_table, ragged, split_cells, split_label
from tdfscal.records import FloatArray

_SEARCHED_ROWS: Final = 256
_PARSER_BLOCK: Final = 1 << 20  # stays in the cache
_RUN = re.compile(rb"[ \t]{2,}|\t|(?m:^ | (?=\r?$))")
_OUTER = re.compile(rb"(?m)^ | (?=\r?$)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_SWAPPED: Final = str.maketrans(".,", ",.")

Rows = tuple[FloatArray, int]
"""(C, N), the wanted columns as recorded, in the order of `Columns.wanted`: NaN in the three of a
signal that a row of a sparse table leaves out. And how many lines these were, blank ones too."""


@record
class Columns:
    """The wanted columns of a table.

    components : per signal, the columns of x, y, z. factors : per signal, of x, y, z, to SI and
    tdfscal's sign. time : its column; None where rows are postures and the file has no time.
    time_factor : to s. zoned : whether the time is written as date and time of day with a zone, or
    without; None where it is a number. sparse : streams take turns: a row holds the cells of some
    signals, those of others are empty.
    """

    table: Table
    components: tuple[tuple[int, int, int], ...]
    factors: tuple[tuple[float, float, float], ...]
    time: int | None
    time_factor: float
    zoned: bool | None
    sparse: bool

    @property
    def wanted(self) -> tuple[int, ...]:
        """Columns to read: x, y, z of each signal in turn, then the time."""
        time = () if self.time is None else (self.time,)
        return (*(column for three in self.components for column in three), *time)


def find_columns(lines: Sequence[str], request: Request) -> Columns:
    """Find the table among the file's first lines, and in it the wanted fields.

    Raises DataError where columns are missing or repeated, or a unit contradicts the mapping.
    """
    mapping = request.mapping
    names = {name for signal in request.signals for name in signal.components}
    table = find_table(lines, names | {mapping.time_field})
    with placed(f"line {max(table.lines - bool(table.below), 1)}"):
        labels = table.labels(names | {mapping.time_field})
        column_of = columns_of(request, [name for name, _ in labels])
        components, factors = [], []
        for signal in request.signals:
            x, y, z = (column_of[name] for name in signal.components)
            components.append((x, y, z))
            stated = [(labels[c][1], table.names[c]) for c in (x, y, z)]
            factors.append(_factors(signal, stated, request))
        rows = [line for line in lines[table.lines :] if line.strip()][:_SEARCHED_ROWS]
        cells = [split_cells(row, table.separator) for row in rows]
        time, time_factor, zoned = column_of.get(mapping.time_field), 1.0, None
        if time is not None:
            first = cells[0][time] if cells and time < len(cells[0]) else ""
            if is_date_time(first):
                zoned = has_zone(first)
            else:
                unit = labels[time][1]
                time_factor = _unit("time", mapping.time_unit, unit, request, table.names[time])
    filled = [
        [sum(c < len(row) and row[c] != "" for c in three) for row in cells] for three in components
    ]
    turns = time is not None and table.separator != " " and bool(cells)
    return Columns(
        table,
        tuple(components),
        tuple(factors),
        time,
        time_factor,
        zoned,
        sparse=turns and takes_turns(np.array(filled)),
    )


def _factors(
    signal: Signal, columns: Sequence[tuple[str | None, str]], request: Request
) -> tuple[float, float, float]:
    """Factors of a signal's x, y, z; columns : the unit that the header states, and its cell."""
    if signal.unit is None or signal.quantity == "temperature":
        return signal.factors
    one = {_unit(signal.quantity, signal.unit, unit, request, cell) for unit, cell in columns}
    if len(one) > 1:
        raise DataError(
            f"the {signal.quantity} of {signal.support} is in different units",
            hint="record x, y and z in one unit",
        )
    factor = math.copysign(one.pop(), signal.factors[0])
    return factor, factor, factor


def _unit(
    quantity: Dimension, declared: str, stated: str | None, request: Request, cell: str
) -> float:
    """Return the factor to SI of a column whose header states a unit, or states none."""
    if stated is None or canonical(stated) == canonical(declared):
        return UNITS[quantity][canonical(declared)]
    factor = unit_factor(quantity, stated)
    if request.declared or factor is None:
        raise DataError(
            f"column {cell!r} is in {stated}, the mapping says {declared}",
            hint=f"state the unit of the {quantity} in the log block of rig.yaml"
            if factor is not None
            else by_scale(quantity, stated)
            or f"record the {quantity} in one of {', '.join(UNITS[quantity])}",
        )
    return factor


class RowParser:
    """Parses blocks of whole lines: those wanted of the table's columns."""

    def __init__(self, columns: Columns, newline: bytes, decimal: str) -> None:
        self._columns, self._newline, self._decimal = columns, newline, decimal
        self._width, self._separator = columns.table.width, columns.table.separator
        names = [str(c) for c in range(self._width)]
        wanted = [str(c) for c in columns.wanted]
        self._read = pa_csv.ReadOptions(
            column_names=names, block_size=_PARSER_BLOCK, use_threads=False
        )
        self._parse = pa_csv.ParseOptions(delimiter=self._separator)
        # Cells without a name are read too, as nothing but empty ones.
        nameless = names[len(columns.table.names) :]
        types = dict.fromkeys(wanted, pa.float64()) | dict.fromkeys(nameless, pa.null())
        if columns.zoned is not None:
            types[str(columns.time)] = pa.string()
        self._convert = pa_csv.ConvertOptions(
            column_types=types,
            include_columns=[*wanted, *nameless],
            null_values=[""] if nameless or columns.sparse else [],
            decimal_point=decimal,
        )

    def fast(self, block: bytes) -> Rows | None:
        """Parse a block of whole lines with pyarrow; None where one might be wrong."""
        lines = block.count(self._newline)
        if block.isspace():
            return np.empty((len(self._columns.wanted), 0)), lines
        source = single_spaces(block) if self._separator == " " else block
        try:
            table = pa_csv.read_csv(pa.BufferReader(source), self._read, self._parse, self._convert)
        except pa.ArrowInvalid:
            return None
        # A quotation mark that is never closed can swallow lines whole.
        whole = lines + (not block.endswith(self._newline))
        if table.num_rows != whole and table.num_rows != sum(1 for _ in self._lines(block, 0)):
            return None
        value = np.empty((len(self._columns.wanted), table.num_rows))
        sparse = self._columns.sparse
        for k, (column, values) in enumerate(zip(table.columns, value, strict=False)):
            if column.null_count and not (sparse and k < len(value) - 1):
                return None
            if pa.types.is_string(column.type):
                values[:] = seconds_of_all(column, zoned=bool(self._columns.zoned))
                if np.isnan(values).any():
                    return None
                continue
            begin = 0
            for chunk in column.chunks:
                values[begin : begin + len(chunk)] = as_numpy(chunk)
                begin += len(chunk)
            # The sum is finite where all are, but for magnitudes that no log has.
            if not np.isfinite(values.sum()) and np.isfinite(values).sum() + column.null_count != (
                values.size
            ):
                return None
        return (value, whole) if not sparse or _whole_signals(value) else None

    def slow(self, block: bytes, first_line: int) -> Rows:
        """Parse a block of whole lines one by one.

        first_line : the number of its first line, from 1. Raises DataError for the first line that
        is wrong.
        """
        kept: list[list[float]] = []
        for number, line in self._lines(block, first_line):
            with placed(f"line {number}"):
                kept.append(self._row(line.decode("utf-8", errors="replace")))
        table = np.array(kept, dtype=np.float64).reshape(len(kept), len(self._columns.wanted))
        return table.T.copy(), block.count(self._newline)

    def ends_alike(self, line: bytes, above: bytes, series: bool) -> bool:
        """Whether a last line without an end is whole: in decimals its last number lacks none.

        above : the whole lines before it. A posture may have any number that one of them has.
        """
        before = above.rstrip().split(self._newline)[-1 if series else 0 :]
        texts = [one.decode("utf-8", errors="replace").strip() for one in (line, *before)]
        cells = [split_cells(text, self._separator) for text in texts if text]
        last, *others = [len(own[-1].partition(self._decimal)[2]) for own in cells]
        if len(cells[0]) != self._width or texts[0].endswith(self._decimal):
            return False
        return [last] == others > [0] if series else last >= min(others, default=0)

    def _lines(self, block: bytes, first_line: int) -> Iterator[tuple[int, bytes]]:
        """Lines that are not blank, with their numbers."""
        for k, line in enumerate(block.split(self._newline)):
            if bare := line.strip(b"\r\n"):
                yield first_line + k, bare

    def _row(self, line: str) -> list[float]:
        columns, names = self._columns, self._columns.table.names
        cells = split_cells(line, self._separator)
        if len(cells) != self._width:
            above = "the header" if self._width == len(names) else "the first row"
            raise ragged(len(cells), self._width, above)
        if any(cells[len(names) :]):
            raise DataError(
                f"{shorten(cells[-1])!r} stands in a column that has no name in the header",
                hint="the other rows end with a separator; record or export the file again",
            )
        wanted = set(columns.wanted)
        for three in columns.components if columns.sparse else ():
            if not any(cells[c] for c in three):
                wanted -= set(three)
        numbers: dict[int, float] = {}
        for c in sorted(wanted):
            dated = columns.zoned is not None and c == columns.time
            if dated:
                value = seconds_of(cells[c], zoned=columns.zoned)
            else:
                value = number_in(cells[c], self._decimal)
            if value is None:
                raise self._fault(cells[c], names[c], dated)
            numbers[c] = value
        return [numbers.get(c, np.nan) for c in columns.wanted]

    def _fault(self, cell: str, name: str, dated: bool) -> DataError:
        bare, _ = split_label(name)
        what, hint = f"{shorten(cell)!r} is not a finite number", _advice(cell, self._decimal)
        if bare and cell.strip() in (name, bare):
            what = "the header stands there again: the recorder was started anew"
            hint = "split the file there; where its clock began anew, that is another campaign"
        elif dated:
            what, hint = f"{shorten(cell)!r} is no date and time as the first row has one", DATES
        elif not cell:
            what, hint = "the cell is empty", "a log has no holes"
        # What is written there is no reading; nothing there may be an axis that nobody measures.
        unread = cell.strip().lower() in ("", "nan")
        fields = (name, bare) if unread else ()
        return DataError(what, where=f"column {name}", hint=hint, fields=fields)


def number_in(cell: str, decimal: str) -> float | None:
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
    return "each cell must be a finite number"


def _whole_signals(value: FloatArray) -> bool:
    """Whether each row has all three cells of a signal, or none of them."""
    missing = np.isnan(value[:-1]).reshape(-1, 3, value.shape[1])
    return bool(np.all(missing[:, 0] == missing[:, 1]) and np.all(missing[:, 0] == missing[:, 2]))


def single_spaces(block: bytes) -> bytes:
    """Lines whose cells are apart by single spaces, with none at the ends."""
    return _OUTER.sub(b"", _RUN.sub(b" ", block)) if _RUN.search(block) else block
