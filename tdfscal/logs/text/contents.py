"""Contents of a text log: its header found without knowing what is wanted."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.logs.common import units
from tdfscal.logs.common.contents import SAMPLES, Contents, Stream, table_contents
from tdfscal.logs.common.damage import damage
from tdfscal.logs.text.cells import fits_header, header_cells, row_cells, split_cells, split_label
from tdfscal.logs.text.date_times import is_date_time, seconds_of_all
from tdfscal.logs.text.header import SEPARATORS, numbered_columns
from tdfscal.logs.text.numbers import Decimal, decimal_of, is_number
from tdfscal.logs.text.reader import HEAD, Source, blocks, decode, open_text
from tdfscal.logs.text.rows import ragged, single_spaces
from tdfscal.logs.text.scope import scope_table
from tdfscal.records import FloatArray

_SEARCHED: Final = 64
_GLANCE: Final = 1 << 16


def text_contents(path: Path) -> Contents:
    """Look through a CSV or TSV file: header and a sample of the rows of each block.

    Raises
    ------
    UsageError, DataError : it cannot be read, or is no table with a header.
    """
    where = str(path)
    with damage(path, pa.ArrowException):
        raw, stream, _ = open_text(path)
        with raw, stream:
            source = Source(stream, None)
            head = source.read(HEAD)
            newline = b"\r" if b"\r" in head and b"\n" not in head else b"\n"
            lines = decode(head, where).splitlines()[: 2 * _SEARCHED]
            scope = scope_table(lines[:_SEARCHED], where)
            if scope is not None:
                separator, number, cells = scope.separator, scope.lines - 1, list(scope.names)
            else:
                separator, number, cells = _header(lines, where)
            body = [c for line in lines[number + 1 :] for c in split_cells(line, separator)]
            decimal = decimal_of(body, separator)
            skipped, stated = number + 1, [split_label(cell)[1] for cell in cells]
            if scope is not None:
                stated = [scope.units.get(k) for k in range(len(cells))]
            elif skipped < len(lines):
                row = [c.strip("[]() ") for c in split_cells(lines[skipped], separator)]
                if fits_header(row, cells) and not any(is_number(c, decimal) for c in row):
                    skipped += 1
                    row += [""] * (len(cells) - len(row))
                    stated = [
                        s or (r if units.is_unit(r) else None)
                        for s, r in zip(stated, row, strict=False)
                    ]
            width = row_cells(lines[skipped:], separator, cells)
            cells, stated = cells[:width], stated[:width]
            table = _Table(width, separator, decimal)
            parts: list[tuple[int, pa.Table]] = []
            count = 0
            for view, whole in blocks(source, head, newline, skipped, where, []):
                block = bytes(view)
                before = count
                count += block.count(newline) + (not block.endswith(newline))
                glance = block if not parts else block[: block.find(newline, _GLANCE) + 1] or block
                parts.append((before, table.parsed(glance, table.odd if whole else [])))
    return _contents(path, cells, stated, parts, count, table)


def _contents(
    path: Path,
    cells: list[str],
    stated: list[str | None],
    parts: list[tuple[int, pa.Table]],
    count: int,
    table: _Table,
) -> Contents:
    problems = _odd_lines(table)
    names = [split_label(cell)[0] for cell in cells]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        problems.append(f"columns are there more than once: {', '.join(twice)}")
    sample: dict[str, FloatArray] = {}
    first: dict[str, FloatArray] = {}
    rows: dict[str, FloatArray] = {}
    kinds = []
    for k, name in enumerate(names):
        types = {str(part.column(k).type) for _, part in parts}
        numeric = bool(types) and all(_is_numeric(part.column(k).type) for _, part in parts)
        number = "date and time" if k in table.dated else "number"
        kinds.append(number if numeric else ("text" if types else "empty"))
        if numeric and name not in twice:
            there = [_filled(part, k, thin=True) for _, part in parts]
            sample[name] = np.concatenate([value for _, value in there])
            rows[name] = np.concatenate(
                [row + before for (before, _), (row, _) in zip(parts, there, strict=True)]
            )
            first[name] = _filled(parts[0][1], k, thin=False)[1][:4096]
    fields, vectors, columns = table_contents(names, kinds, stated, sample, first, rows)
    return Contents(
        path, "csv", path.stat().st_size, (Stream("table", "", count, fields),), vectors, columns,
        decimal=table.decimal, problems=tuple(problems),
    )  # fmt: skip


def _header(lines: list[str], where: str) -> tuple[str, int, list[str]]:
    """Separator, line number and cells of the first line of names above most lines."""
    best: tuple[int, int, str, list[str]] | None = None
    ragged_at: tuple[int, int, int] | None = None
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
            near = number - 1
            above = header_cells(lines[near], separator) if near >= 0 else []
            if abs(len(above) - width) > 1 or _has_number(above):
                continue
            if not fits_header(split[number], above):
                ragged_at = ragged_at or (number, width, len(above))
                continue
            number = near
        # Commas within numbers make columns too; the header has none of them then.
        if best is None or width > best[0]:
            best = (width, number, separator, header_cells(lines[number], separator))
    if best is None and ragged_at is not None:
        number, width, expected = ragged_at
        raise ragged(width, expected, f"{where}, line {number + 1}")
    for numbered in (numbered_columns(lines, decimal) for decimal in ".,"):
        if numbered is not None and (best is None or len(numbered.cells) > best[0]):
            return numbered.separator, numbered.line, list(numbered.cells)
    if best is not None:
        return best[2], best[1], best[3]
    raise DataError(
        "there is no table of numbers",
        where=where,
        hint="export the recording as a table, with the columns' names in the first line",
    )


def _has_number(cells: list[str]) -> bool:
    return any(is_number(c, d) for c in cells for d in ".,")


@dataclass(frozen=True, slots=True)
class _Table:
    """How to parse the rows: cells in each, separator, decimal.

    odd : takes the numbers of cells of the lines that have others. dated : the columns of dates.
    """

    width: int
    separator: str
    decimal: Decimal
    odd: list[int] = field(default_factory=list)
    dated: set[int] = field(default_factory=set)

    def parsed(self, block: bytes, odd: list[int]) -> pa.Table:
        """Parse whole lines; those with another number of cells are left out, and noted."""

        def leave_out(row: pa_csv.InvalidRow) -> str:
            odd.append(row.actual_columns)
            return "skip"

        if self.separator == " ":
            block = single_spaces(block)
        table = pa_csv.read_csv(
            pa.BufferReader(block),
            pa_csv.ReadOptions(
                column_names=[str(k) for k in range(self.width)],
                # At once, so that no line is longer than what is parsed at a time.
                block_size=len(block) + 1,
                # Lines that are left out are decoded, and Latin-1 decodes whatever there is.
                encoding="utf8" if block.isascii() else "latin1",
                # Its threads would call the handler, and have ended the process over long lines.
                use_threads=False,
            ),
            pa_csv.ParseOptions(delimiter=self.separator, invalid_row_handler=leave_out),
            # Dates as text: one reader of them, for all notations.
            pa_csv.ConvertOptions(decimal_point=self.decimal, timestamp_parsers=["never"]),
        )
        for k, column in enumerate(table.columns):
            if not (pa.types.is_string(column.type) and len(column)):
                continue
            if is_date_time(column[0].as_py()) and (seconds := seconds_of_all(column)) is not None:
                self.dated.add(k)
                table = table.set_column(k, str(k), [as_arrow(seconds)])
        return table


def _odd_lines(table: _Table) -> list[str]:
    if not table.odd:
        return []
    found = ", ".join(str(n) for n in sorted(set(table.odd))[:3])
    found += " cell" if found == "1" else " cells"
    many = "a line has" if len(table.odd) == 1 else f"{len(table.odd)} lines have"
    return [
        f"{many} {found} where a row has {table.width}; the file may be damaged there: "
        "record or export it again"
    ]


def _is_numeric(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind))


def _filled(part: pa.Table, k: int, *, thin: bool) -> tuple[FloatArray, FloatArray]:
    """Rows (N,) of a column that hold a number, and the numbers; thin: some of them."""
    column = part.column(k)
    there = (
        np.flatnonzero(as_numpy(column.is_valid().cast(pa.int8()))) if column.null_count else None
    )
    count = len(column) if there is None else len(there)
    if thin and count > SAMPLES:
        chosen = np.linspace(0, count - 1, SAMPLES).astype(np.int64)
        there = chosen if there is None else there[chosen]
    if there is not None:
        column = column.take(as_arrow(there))
    rows = np.arange(len(column)) if there is None else there
    return rows.astype(np.float64), as_numpy(column.cast(pa.float64(), safe=False))
