"""Logs as text: CSV, TSV and what recorders make of them, plain or compressed, block by block."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, Literal

import pyarrow as pa
import pyarrow.csv as pa_csv
import zstandard

from tdfscal.errors import DataError
from tdfscal.logs.log_file import AGAIN, EMPTY, LogFile, Piece, Request, mapped
from tdfscal.logs.table import table_piece
from tdfscal.logs.text.header import SEARCHED, find_table, is_number, split_cells
from tdfscal.logs.text.rows import RowParser, Rows, find_columns, number_in, single_spaces
from tdfscal.records import Integrity

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents

Decimal = Literal[".", ","]

_THREADS: Final = 2
_GLANCE: Final = 1 << 16
_BLOCK: Final = 8 << 20
_COMPRESSED: Final = 1 << 16
_COMPRESSED_ZSTD: Final = 1 << 12  # may expand to as many times as much
_HEAD: Final = 1 << 18
_OPENING: Final = 1 << 12
_CONTROL: Final = bytes({*range(1, 32)} - set(b"\t\n\v\f\r"))
_BLANK: Final = b" \t\n\v\f\r\x1a"  # with the mark at which DOS ends a text
_GZIP, _ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


class TextLog(LogFile):
    """One text file, plain or compressed."""

    faults = (pa.ArrowException, zlib.error, zstandard.ZstdError)

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the rows of the wanted columns."""
        with open_text(self.path) as file:
            columns = find_columns(file.lines, request)
            parser = RowParser(columns, file.newline, request.mapping.decimal)
            begin, n = columns.table.lines, len(columns.factors)
            line, rows_before, series = begin + 1, 0, request.mapping.rows == "timeseries"
            above, ended = b"", True

            def parsed(given: tuple[bytes, bool]) -> tuple[bytes, bool, Rows | None]:
                return (*given, parser.fast(given[0]))

            with closing(mapped(parsed, file.blocks(begin), _THREADS)) as results:
                for block, whole, fast in results:
                    if not (whole or parser.ends_alike(block, above, series)):
                        continue
                    above, ended = block, whole
                    value, lines = fast or parser.slow(block, line)
                    vectors = value[: 3 * n].reshape(n, 3, value.shape[1])
                    time = None if columns.time is None else value[-1] * columns.time_factor
                    piece = table_piece(
                        request, vectors, columns.factors, time, rows_before, sparse=columns.sparse
                    )
                    rows_before += value.shape[1]
                    line += lines
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
        """Its columns, and some rows of each block."""
        from tdfscal.logs.contents import SAMPLES, TableLook  # not needed to read it

        with open_text(self.path) as file:
            lines = file.lines[: 2 * SEARCHED]
            table = find_table(lines)
            labels = table.labels()[: table.width]
            cells = (c for line in lines[table.lines :] for c in split_cells(line, table.separator))
            comma = table.separator != "," and any(map(_WITH_COMMA.fullmatch, cells))
            decimal: Decimal = "," if comma else "."
            look, count = TableLook(SAMPLES), 0
            for block, _ in file.blocks(table.lines):
                end = block.find(file.newline, _GLANCE) + 1 if count else 0
                part = block[: end or None]
                look.add(count, _looked_at(part, table.separator, table.width, decimal))
                count += block.count(file.newline) + (not block.endswith(file.newline))
        columns = [(str(k), name, look.kind(str(k)), unit) for k, (name, unit) in enumerate(labels)]
        return look.contents(self.path, "csv", count, columns, decimal)


def _looked_at(block: bytes, separator: str, width: int, decimal: Decimal) -> pa.Table:
    """Some whole lines without knowing what is wanted; those with other cells are left out."""
    table = pa_csv.read_csv(
        pa.BufferReader(single_spaces(block) if separator == " " else block),
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
            numbers = [_number(cell, decimal) for cell in column.to_pylist()]
            table = table.set_column(k, str(k), pa.array(numbers, pa.float64()))
    return table


def _number(cell: str, decimal: Decimal) -> float | None:
    """The number in a cell, with the other decimal too: reading the column says what is wrong."""
    number = number_in(cell, decimal)
    return number_in(cell, ".") if number is None else number


@contextmanager
def open_text(path: Path) -> Iterator[TextFile]:
    """Open a file for one reading; compressed or not by its first bytes, not by its name."""
    with path.open("rb") as raw:
        magic = raw.read(64)
        raw.seek(0)
        parts = iter(lambda: raw.read(_BLOCK), b"")
        integrity: Integrity = "unverified"
        if magic.startswith(_GZIP):
            gzip = partial(zlib.decompressobj, 31)
            parts, integrity = _expanded(raw, gzip, _COMPRESSED, _BLOCK), "verified"
        elif magic.startswith(_ZSTD):
            checked = zstandard.get_frame_parameters(magic).has_checksum
            integrity = "verified" if checked else "unverified"
            zstd = zstandard.ZstdDecompressor().decompressobj
            parts = _expanded(raw, zstd, _COMPRESSED_ZSTD)
        yield TextFile(raw, parts, integrity)


class TextFile:
    """A text log that is open.

    cut_at : byte of the text at which one that was cut short stops being whole; None of a whole
    one. integrity : how far its compression checks the content. lines : the first ones.
    newline : what ends each.
    """

    def __init__(self, raw: BinaryIO, parts: Iterator[bytes], integrity: Integrity) -> None:
        self._raw, self._parts, self._rest = raw, parts, b""
        self.integrity = integrity
        self.cut_at: int | None = None
        self._expanded = 0
        self._head = self._read(_HEAD)
        text = decoded(self._head)
        if self.cut_at is None and not self._head.strip():
            raise DataError("the file is empty", hint=AGAIN)
        if b"\n" not in self._head and b"\r" not in self._head:
            raise DataError("the file was cut short within its first line", hint=AGAIN)
        self.newline = b"\r" if b"\r" in self._head and b"\n" not in self._head else b"\n"
        self.lines = lines_of(text)

    def blocks(self, skipped: int) -> Iterator[tuple[bytes, bool]]:
        """Yield blocks of whole lines after the first ones; False with a last line without an end.

        Raises DataError for a line without end.
        """
        parts = self._head.split(self.newline, skipped)
        rest = parts[skipped] if len(parts) > skipped else b""
        while chunk := self._read(_BLOCK):
            end = chunk.rfind(self.newline) + 1
            if end:
                yield b"".join((rest, memoryview(chunk)[:end])), True
                rest = chunk[end:]
                continue
            rest += chunk
            if len(rest) > 2 * _BLOCK:
                raise _no_table(f"a line is longer than {2 * _BLOCK >> 20} MiB")
        end = rest.rfind(self.newline) + 1
        if end:
            yield rest[:end], True
        if rest[end:].strip(_BLANK):
            there = self.cut_at is None  # all that was compressed
            self.cut_at = self._expanded - len(rest) + end
            if there:
                yield rest[end:], False

    def _read(self, size: int) -> bytes:
        """Up to so many bytes; none at the end."""
        parts, there = [self._rest], len(self._rest)
        while there < size:
            try:
                part = next(self._parts, None)
            except EOFError:
                self.cut_at, self.integrity, part = self._expanded + there, "unverified", None
            if part is None:
                break
            parts.append(part)
            there += len(part)
        whole = b"".join(parts) if len(parts) > 1 else parts[0]
        self._rest = whole[size:]
        self._expanded += min(there, size)
        return whole[:size] if self._rest else whole


def _expanded(raw: BinaryIO, fresh: Callable[[], Any], size: int, *most: int) -> Iterator[bytes]:
    """Expand stream by stream; raises EOFError at the end of a file that was cut short.

    fresh : begins a stream. size : read at a time. most : of what it gives at a time, if it can.
    """
    stream, data = fresh(), b""
    while data := data or raw.read(size):
        if stream.eof:
            stream = fresh()
        yield stream.decompress(data, *most)
        data = stream.unused_data if stream.eof else stream.unconsumed_tail
    yield stream.flush()
    if not stream.eof:
        raise EOFError


def lines_of(text: str) -> list[str]:
    """Lines as the rows have them: nothing but line feeds ends them, or returns without any."""
    lines = [line.removesuffix("\r") for line in text.split("\n" if "\n" in text else "\r")]
    return lines if lines[-1] else lines[:-1]


def decoded(head: bytes) -> str:
    """The first lines; in the rows only ASCII matters.

    Raises DataError where the text is UTF-16 or none at all, or its first line has no end.
    """
    opening = head[:_OPENING]
    # ASCII as UTF-16 has a NUL in every second byte.
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or opening.count(0) > 0.4 * len(opening) > 0:
        raise DataError("the text is UTF-16", hint="export it as UTF-8")
    if len(opening) - len(opening.translate(None, _CONTROL)) > len(opening) // 20:
        hint = "export the recording as CSV, or name the file by what it is"
        raise DataError("the file is not text", hint=hint)
    if len(head) >= _HEAD and not (b"\n" in head or b"\r" in head):
        raise _no_table(f"the first line is longer than {_HEAD >> 10} KiB")
    # The last character may be cut in two by the block's end; it is far below the header.
    whole = head[: max(head.rfind(b"\n"), head.rfind(b"\r")) + 1] or head
    try:
        text = whole.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = whole.decode("cp1252", errors="replace")
    return text.replace("\0", "\ufffd")


def _no_table(what: str) -> DataError:
    return DataError(what, hint="this is not a table of numbers")
