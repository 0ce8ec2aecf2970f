"""Logs as text: CSV, TSV and what recorders make of them; plain, gzip or zstd."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from io import BufferedIOBase
from pathlib import Path
from typing import Final, cast

import numpy as np
import pyarrow as pa
import zstandard

from tdfscal.errors import DataError
from tdfscal.logs.common.damage import damage, one_line
from tdfscal.logs.common.read_ahead import mapped
from tdfscal.logs.common.request import (
    Block,
    Outcome,
    Piece,
    Reached,
    Request,
    by_signal,
    split,
)
from tdfscal.logs.text.header import Header, find_header
from tdfscal.logs.text.rows import RowParser, Rows
from tdfscal.records import FloatArray, Integrity

_BLOCK: Final = 8 << 20
_LINE: Final = 1 << 16
_THREADS: Final = 2
HEAD: Final = 1 << 18
_MAX_SAMPLES: Final = 1 << 16
_OPENING: Final = 1 << 12
_CONTROL: Final = bytes({*range(1, 32)} - set(b"\t\n\v\f\r"))
_GZIP, _ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"


def read_text(
    path: Path, request: Request, *, salvage: bool, reached: Reached
) -> Generator[Piece, None, Outcome]:
    """Read a text log in pieces; see `request.Reader`.

    Raises
    ------
    DataError : with the line and column of what is wrong.
    """
    where = str(path)
    with damage(path, pa.ArrowException):
        raw, stream, integrity = open_text(path)
        with raw, stream:
            lost: list[str] = []
            source = Source(stream, lost if salvage else None)
            head = source.read(HEAD)
            newline = b"\r" if b"\r" in head and b"\n" not in head else b"\n"
            text = decode(head, where)
            header = find_header(text, request, where=where)
            parser = RowParser(header, newline, request.decimal, where)
            line = header.lines + 1
            rows_before, faults, endless = 0, 0, False
            warnings: list[str] = []

            def parsed(given: tuple[memoryview, bool]) -> tuple[memoryview, bool, Rows | None]:
                return (*given, parser.fast(given[0]))

            spare: list[bytearray] = []
            whole_lines = blocks(source, head, newline, header.lines, where, spare)
            with closing(mapped(parsed, whole_lines, _THREADS)) as results:
                for block, whole, fast in results:
                    if not whole and request.rows == "timeseries":
                        endless = True
                        warnings.append(
                            f"{where}: the last line has no end and may be cut short; "
                            "it is left out"
                        )
                        continue
                    rows = fast or parser.slow(block, line, salvage=salvage)
                    spare.append(cast(bytearray, block.obj))
                    piece = _piece(rows, header, request, rows_before)
                    rows_before += rows.count
                    faults += rows.faults
                    line += rows.lines
                    reached(raw.tell())
                    yield from split(piece, _MAX_SAMPLES)
    if rows_before == 0 and endless:
        raise DataError(
            "the only row below the header has no end and may be cut short",
            where=where,
            hint="record the log again, or end the line if the row is whole",
        )
    if rows_before == 0:
        raise DataError(
            "the file has a header and no rows", where=where, hint="record the log again"
        )
    warnings += [f"{where}: {what}" for what in lost]
    if faults:
        warnings.append(f"{where}: {faults} lines cannot be read and are left out")
    return Outcome("salvaged" if salvage and (faults or warnings) else integrity, tuple(warnings))


def open_text(path: Path) -> tuple[BufferedIOBase, BufferedIOBase, Integrity]:
    """Open a plain or compressed file by its first bytes, not by its name.

    Returns
    -------
    The file as it is stored, its text, and how far its compression checks the content.
    """
    with path.open("rb") as probe:
        magic = probe.read(64)
    if magic.startswith(_GZIP):
        raw = path.open("rb")
        return raw, cast(BufferedIOBase, pa.input_stream(raw, compression="gzip")), "verified"
    if magic.startswith(_ZSTD):
        try:
            checked = zstandard.get_frame_parameters(magic).has_checksum
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
        raw = path.open("rb")
        stream = cast(BufferedIOBase, pa.input_stream(raw, compression="zstd"))
        return raw, stream, "verified" if checked else "unverified"
    raw = path.open("rb")
    return raw, raw, "unverified"


def decode(head: bytes, where: str) -> str:
    """Decode the first lines; in the rows only ASCII matters.

    Raises
    ------
    DataError : the text is UTF-16 or none at all, or its first line has no end.
    """
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or _every_second_is_nul(head):
        raise DataError("the text is UTF-16", where=where, hint="export it as UTF-8")
    opening = head[:_OPENING]
    if len(opening) - len(opening.translate(None, _CONTROL)) > len(opening) // 20:
        raise DataError(
            "the file is not text",
            where=where,
            hint="export the recording as CSV, or name the file by what it is",
        )
    if len(head) >= HEAD and not (b"\n" in head or b"\r" in head):
        raise DataError(
            f"the first line is longer than {HEAD >> 10} KiB",
            where=where,
            hint="this is not a table of numbers",
        )
    # The last character may be cut in two by the block's end; it is far below the header.
    whole = head[: max(head.rfind(b"\n"), head.rfind(b"\r")) + 1] or head
    try:
        text = whole.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = whole.decode("cp1252", errors="replace")
    return text.replace("\0", "\ufffd")


def _every_second_is_nul(head: bytes) -> bool:
    """ASCII as UTF-16 without a mark at its start: one of two bytes is NUL, the other is not."""
    opening = head[:_OPENING]
    share = [opening[k::2].count(0) / max(len(opening[k::2]), 1) for k in (0, 1)]
    return min(share) < 0.1 and max(share) > 0.9


class Source:
    """A stream that may break off where `lost` takes the reason (salvage)."""

    def __init__(self, stream: BufferedIOBase, lost: list[str] | None) -> None:
        self._stream, self._lost = stream, lost

    def read(self, size: int) -> bytes:
        """Read up to `size` bytes; none at the end."""
        buffer = bytearray(size)
        return bytes(memoryview(buffer)[: self.readinto(memoryview(buffer))])

    def readinto(self, buffer: memoryview) -> int:
        """Read up to as many bytes as the buffer has; how many, none at the end."""
        try:
            return 0 if self._lost else self._stream.readinto(buffer)
        except (OSError, pa.ArrowException) as error:
            if self._lost is None:
                raise
            self._lost.append(f"the file is damaged ({one_line(error)}); what follows is lost")
            return 0


def blocks(
    source: Source,
    head: bytes,
    newline: bytes,
    skipped: int,
    where: str,
    spare: list[bytearray],
) -> Iterator[tuple[memoryview, bool]]:
    """Yield blocks of whole lines after the header; False with a last line without an end.

    spare : takes what a block was read into, from who is done with it, to be used again.
    """
    start = 0
    for _ in range(skipped):
        found = head.find(newline, start)
        if found < 0:
            return
        start = found + 1
    rest = head[start:]
    while True:
        room = spare.pop() if spare else bytearray()
        if len(room) < len(rest) + _BLOCK:
            room = bytearray(len(rest) + _BLOCK + _LINE)
        room[: len(rest)] = rest
        block = memoryview(room)
        count = source.readinto(block[len(rest) : len(rest) + _BLOCK])
        if not count:
            break
        filled = len(rest) + count
        end = room.rfind(newline, 0, filled) + 1
        rest = bytes(block[end:filled])
        if end:
            yield block[:end], True
        elif len(rest) > 2 * _BLOCK:
            raise DataError(
                f"a line is longer than {2 * _BLOCK >> 20} MiB", where=where,
                hint="this is not a table of numbers",
            )  # fmt: skip
    end = rest.rfind(newline) + 1
    if end:
        yield memoryview(bytearray(rest[:end])), True
    if rest[end:].strip():
        yield memoryview(bytearray(rest[end:])), False


def _piece(rows: Rows, header: Header, request: Request, rows_before: int) -> Piece:
    value: dict[int, FloatArray] = {}
    for number, factor in enumerate(header.factors):
        vector = rows.value[3 * number : 3 * number + 3]
        scale = request.signals[number].scale
        if scale is not None:
            vector *= np.array(scale)[:, None]
        elif factor != 1.0:
            vector *= factor
        value[number] = vector.T
    if header.time is None:
        time = np.arange(rows_before, rows_before + rows.count, dtype=np.float64)
        return (Block("row", time, value),)
    time, clock = rows.value[-1] * header.time_factor, f"column {request.time_field}"
    if not header.sparse:
        return (Block(clock, time, value),)
    return by_signal(clock, time, value, request)
