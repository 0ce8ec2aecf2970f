"""The wanted columns of a text log, in which units, and its rows: parsed fast, or line by line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.files.units import UNITS, Quantity, by_scale, canonical, unit_factor
from tdfscal.files.yaml import shorten
from tdfscal.frozen import record
from tdfscal.logs.log_file import AGAIN, placed
from tdfscal.logs.request import Request, Signal
from tdfscal.logs.table import (
    DATES,
    columns_of,
    has_zone,
    is_date_time,
    seconds_of,
    seconds_of_all,
    takes_turns,
)
from tdfscal.logs.text.head import (
    END,
    Head,
    advice,
    best_line,
    is_number_of_either,
    number_in,
    numbered_columns,
    ragged,
    row_cells,
    scope_head,
    split_cells,
    split_label,
    units_below,
)
from tdfscal.records import FloatArray

_SEARCHED_ROWS = 256


@record
class Header:
    """How to read the table.

    lines : how many lines of the file come before the first row.
    columns : how many cells a row has: as many as names, but for a separator at the end of one of
    the two; a cell without a name is empty in every row.
    time : column of the time; None where rows are postures and the file has no time.
    zoned : whether the time is written as date and time of day with a zone, or without; None where
        it is a number.
    components : per signal, the columns of x, y, z.
    factors : per signal, of x, y, z, to SI and tdfscal's sign.
    time_factor : to s.
    sparse : streams take turns: a row holds the cells of some signals, those of others are empty.
    ends : the last line may say EOF.
    """

    separator: str
    lines: int
    columns: int
    names: tuple[str, ...]
    time: int | None
    zoned: bool | None
    components: tuple[tuple[int, int, int], ...]
    factors: tuple[tuple[float, float, float], ...]
    time_factor: float
    sparse: bool = False
    ends: bool = False

    @property
    def wanted(self) -> tuple[int, ...]:
        """Columns to read: x, y, z of each signal in turn, then the time."""
        time = () if self.time is None else (self.time,)
        return (*(column for three in self.components for column in three), *time)


def find_header(lines: Sequence[str], request: Request) -> Header:
    """Find the header line among the file's first, and resolve the wanted fields to columns.

    The line that holds most of the wanted names is the header, whatever comes before it. Columns
    of a table without one are named by their numbers, from 1.

    Raises DataError where columns are missing or repeated, or a unit contradicts the mapping.
    """
    names = [name for signal in request.signals for name in signal.components]
    wanted = {request.mapping.time_field, *names}
    best = _head(lines, names, wanted, request.mapping.decimal)
    with placed(f"line {max(best.line, 0) + 1}"):
        labels = [split_label(cell, wanted) for cell in best.cells]
        column_of = columns_of(request, [name for name, _ in labels])
        row_units, above = best.units, best.lines
        if not best.scope:
            row_units = units_below(lines, best, list(column_of.values())) or {}
            above = best.line + 1 + bool(row_units)
        stated = [unit or row_units.get(c) for c, (_, unit) in enumerate(labels)]
        time = column_of.get(request.mapping.time_field)
        first = next((line for line in lines[above:] if line.strip()), "")
        opening = split_cells(first, best.separator)
        dated = time is not None and time < len(opening) and is_date_time(opening[time])
        components = []
        factors = []
        for signal in request.signals:
            x, y, z = (column_of[name] for name in signal.components)
            components.append((x, y, z))
            named = [(stated[c], best.cells[c]) for c in (x, y, z)]
            factors.append(_factors(signal, named, request))
        time_factor = 1.0
        if time is not None and not dated:
            unit = request.mapping.time_unit
            time_factor = _unit("time", unit, stated[time], request, best.cells[time])
    return Header(
        separator=best.separator,
        lines=above,
        columns=row_cells(lines[above:], best.separator, best.cells),
        names=best.cells,
        time=time,
        zoned=has_zone(opening[time]) if time is not None and dated else None,
        components=tuple(components),
        factors=tuple(factors),
        time_factor=time_factor,
        ends=best.scope,
        sparse=time is not None and _takes_turns(lines[above:], best.separator, components),
    )


def _head(lines: Sequence[str], names: Sequence[str], wanted: set[str], decimal: str) -> Head:
    """The line of the columns' names."""
    best = scope_head(lines) or best_line(lines, wanted, decimal)
    if best is None:
        raise DataError("it begins with nothing but blank lines", hint=AGAIN)
    if best.scope:
        return best
    if all(name.isdecimal() for name in names):
        return numbered_columns(lines, decimal) or best
    if best.named == 0 and all(is_number_of_either(c) for c in best.cells):
        raise DataError(
            "there is no header line; the first line holds numbers",
            where=f"line {best.line + 1}",
            hint="put the columns' names in the first line, or name the fields of the log block "
            "by their numbers: 1, 2, …",
        )
    return best


def _takes_turns(
    rows: Sequence[str], separator: str, components: Sequence[tuple[int, int, int]]
) -> bool:
    """Whether a table is of streams with times of their own; see `request.takes_turns`."""
    if separator == " ":
        return False
    cells = [split_cells(line, separator) for line in rows[:_SEARCHED_ROWS] if line.strip()]
    filled = [
        [sum(c < len(r) and r[c] != "" for c in three) for r in cells] for three in components
    ]
    return bool(cells) and takes_turns(np.array(filled))


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
    quantity: Quantity, declared: str, stated: str | None, request: Request, cell: str
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


_PARSER_BLOCK = 1 << 20  # stays in the cache
_RUN = re.compile(rb"[ \t]{2,}|\t|(?m:^ | (?=\r?$))")
_OUTER = re.compile(rb"(?m)^ | (?=\r?$)")


Rows = tuple[FloatArray, int]
"""(C, N), the wanted columns as recorded, in the order of `Header.wanted`: NaN in the three of a
signal that a row of a sparse table leaves out. And how many lines these were, blank ones too."""


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
            return np.empty((len(self._header.wanted), 0)), lines
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
        table = np.array(kept, dtype=np.float64).reshape(len(kept), len(self._header.wanted))
        return table.T.copy(), block.count(self._newline)

    def ends_alike(self, line: bytes, above: bytes, series: bool) -> bool:
        """Whether a last line without an end is whole: in decimals its last number lacks none.

        above : the whole lines before it. A posture may have any number that one of them has.
        """
        before = above.rstrip().split(self._newline)[-1 if series else 0 :]
        texts = [one.decode("utf-8", errors="replace").strip() for one in (line, *before)]
        cells = [split_cells(text, self._header.separator) for text in texts if text]
        last, *others = [len(own[-1].partition(self._decimal)[2]) for own in cells]
        if len(cells[0]) != self._header.columns or texts[0].endswith(self._decimal):
            return False
        return [last] == others > [0] if series else last >= min(others, default=0)

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


def _whole_signals(value: FloatArray) -> bool:
    """Whether each row has all three cells of a signal, or none of them."""
    missing = np.isnan(value[:-1]).reshape(-1, 3, value.shape[1])
    return bool(np.all(missing[:, 0] == missing[:, 1]) and np.all(missing[:, 0] == missing[:, 2]))


def single_spaces(block: bytes) -> bytes:
    """Lines whose cells are apart by single spaces, with none at the ends."""
    return _OUTER.sub(b"", _RUN.sub(b" ", block)) if _RUN.search(block) else block
