"""A text log's bytes: plain or compressed, its first lines, and blocks of whole lines."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from typing import Any, BinaryIO, Final

import zstandard

from tdfscal.errors import DataError
from tdfscal.logs.log_file import AGAIN
from tdfscal.records import Integrity

_BLOCK: Final = 8 << 20
_COMPRESSED: Final = 1 << 16
_COMPRESSED_ZSTD: Final = 1 << 12  # may expand to as many times as much
_HEAD: Final = 1 << 18
_OPENING: Final = 1 << 12
_CONTROL: Final = bytes({*range(1, 32)} - set(b"\t\n\v\f\r"))
_BLANK: Final = b" \t\n\v\f\r\x1a"  # with the mark at which DOS ends a text
_GZIP, _ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"
_NO_TABLE: Final = "this is not a table of numbers"


class TextFile:
    """A text log that is open; compressed or not by its first bytes, not by its name.

    cut_at : byte of the text at which one that was cut short stops being whole; None of a whole
    one. integrity : how far its compression checks the content. lines : the first ones.
    newline : what ends each.
    """

    def __init__(self, raw: BinaryIO) -> None:
        magic = raw.read(64)
        raw.seek(0)
        parts = iter(partial(raw.read, _BLOCK), b"")
        self.integrity: Integrity = "unverified"
        if magic.startswith(_GZIP):
            self.integrity = "verified"
            parts = _expanded(raw, partial(zlib.decompressobj, 31), _COMPRESSED, _BLOCK)
        elif magic.startswith(_ZSTD):
            if zstandard.get_frame_parameters(magic).has_checksum:
                self.integrity = "verified"
            parts = _expanded(raw, zstandard.ZstdDecompressor().decompressobj, _COMPRESSED_ZSTD)
        self.cut_at: int | None = None
        self._expanded = 0
        self._chunks = self._together(parts)
        self._first = next(self._chunks, b"")
        head = self._first[:_HEAD]
        text = decoded(head)
        if self.cut_at is None and not head.strip():
            raise DataError("the file is empty", hint=AGAIN)
        if b"\n" not in head and b"\r" not in head:
            if len(head) >= _HEAD:
                what = f"the first line is longer than {_HEAD >> 10} KiB"
                raise DataError(what, hint=_NO_TABLE)
            raise DataError("the file was cut short within its first line", hint=AGAIN)
        self.newline = b"\r" if b"\r" in head and b"\n" not in head else b"\n"
        self.lines = lines_of(text)

    def blocks(self, skipped: int) -> Iterator[tuple[bytes, bool]]:
        """Yield blocks of whole lines after the first ones; False with a last line without an end.

        Raises DataError for a line without end.
        """
        rest, first = b"", self._first.split(self.newline, skipped)[skipped:]
        for chunk in chain(first, self._chunks):
            if end := chunk.rfind(self.newline) + 1:
                yield b"".join((rest, memoryview(chunk)[:end])), True
                rest = chunk[end:]
                continue
            rest += chunk
            if len(rest) > 2 * _BLOCK:
                what = f"a line is longer than {2 * _BLOCK >> 20} MiB"
                raise DataError(what, hint=_NO_TABLE)
        if rest.strip(_BLANK):
            there = self.cut_at is None  # all that was compressed
            self.cut_at = self._expanded - len(rest)
            if there:
                yield rest, False

    def _together(self, parts: Iterator[bytes]) -> Iterator[bytes]:
        """What is expanded in chunks of a block and more, to the end of what is there."""
        waiting, size, more = list[bytes](), 0, True
        while more:
            try:
                part = next(parts, b"")
                more = bool(part)
            except EOFError:
                part, more, self.integrity = b"", False, "unverified"
                self.cut_at = self._expanded + size
            waiting.append(part)
            size += len(part)
            if size >= _BLOCK or (size and not more):
                self._expanded += size
                yield b"".join(waiting)
                waiting, size = [], 0


def _expanded(raw: BinaryIO, fresh: Callable[[], Any], size: int, *most: int) -> Iterator[bytes]:
    """Expand stream by stream; raises EOFError at the end of a file that was cut short.

    fresh : begins a stream. size : read at a time. most : of what it gives at a time, if it can.
    """
    stream, data = fresh(), b""
    while data := data or raw.read(size):
        if stream.eof:
            stream = fresh()
        if part := stream.decompress(data, *most):
            yield part
        data = stream.unused_data if stream.eof else stream.unconsumed_tail
    if part := stream.flush():
        yield part
    if not stream.eof:
        raise EOFError


def lines_of(text: str) -> list[str]:
    """Lines as the rows have them: nothing but line feeds ends them, or returns without any."""
    lines = [line.removesuffix("\r") for line in text.split("\n" if "\n" in text else "\r")]
    return lines if lines[-1] else lines[:-1]


def decoded(head: bytes) -> str:
    """The first lines; in the rows only ASCII matters.

    Raises DataError where the text is UTF-16, UTF-32 or none at all.
    """
    opening = head[:_OPENING]
    if not opening.strip(b"\0"):
        raise DataError("the file holds nothing but zeros: nothing was written to it", hint=AGAIN)
    # ASCII as UTF-16 has a NUL in every second byte.
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or opening.count(0) > 0.4 * len(opening) > 0:
        raise DataError("the text is UTF-16 or UTF-32", hint="export it as UTF-8")
    if len(opening) - len(opening.translate(None, _CONTROL)) > len(opening) // 20:
        hint = "export the recording as CSV, or name the file by what it is"
        raise DataError("the file is not text", hint=hint)
    # The last character may be cut in two by the block's end; it is far below the header.
    whole = head[: max(head.rfind(b"\n"), head.rfind(b"\r")) + 1] or head
    try:
        text = whole.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = whole.decode("cp1252", errors="replace")
    return text.replace("\0", "\ufffd")
