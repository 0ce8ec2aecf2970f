"""The records of an MCAP file, one after the other: marks, lengths, the file's end."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode

from tdfscal.errors import DataError

_MAGIC: Final = b"\x89MCAP0\r\n"
HEAD: Final = struct.Struct("<BQ")
_MAX_RECORD: Final = 128 << 20
_PIECE: Final = 1 << 20
_PRIVATE: Final = 0x80
_PASSED: Final = frozenset({Opcode.ATTACHMENT, Opcode.METADATA})
IN_SUMMARY: Final = frozenset(
    {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX}
    | {Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER}
)
_COMPRESSED: Final = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd"}
HINT: Final = "copy the recording again; `calibrate --salvage` reads what is sound"


def summary_crc(crc: int, footer: bytes) -> int:
    """The checksum of a summary by that of the records before the footer; footer : its content."""
    return zlib.crc32(HEAD.pack(Opcode.FOOTER, len(footer)) + footer[:16], crc)


class TruncatedError(DataError):
    """The file ends, or stops making sense, before its end: what comes after cannot be read."""


class RecordStream:
    """Records of a file one after the other, none longer than the file; keeps a running CRC.

    start : where the latest record begins. crc_before : of all before it.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file = file
        self._size = path.stat().st_size
        self.position = self.start = 0
        self.crc = self.crc_before = 0

    def seek(self, position: int) -> None:
        """Go on from another place."""
        self._file.seek(position)
        self.position, self.crc = position, 0

    def record(self, allowed: frozenset[Opcode]) -> tuple[int, bytes]:
        """Return the next record's opcode and content; private records are passed over."""
        while True:
            start = self.start = self.position
            self.crc_before = self.crc
            opcode, length = HEAD.unpack(self._read(HEAD.size))
            if length > self._size - self.position:
                raise self._cut(f"the file ends within a record that starts at byte {start}")
            if opcode in _PASSED and opcode in allowed:
                self._pass(length)
                return opcode, b""
            if opcode in allowed:
                if length > _MAX_RECORD:
                    raise self._cut(
                        f"a record of {length} bytes at byte {start} is larger than "
                        f"{_MAX_RECORD >> 20} MiB"
                    )
                return opcode, self._read(length)
            self._pass(length)
            if opcode < _PRIVATE:
                raise self._cut(f"a record of kind {opcode:#04x} has no place at byte {start}")

    def opening(self) -> None:
        """Read the mark at the start."""
        head = self._read(len(_MAGIC), short=True)
        for magic, kind in _COMPRESSED.items():
            if head.startswith(magic):
                raise DataError(
                    f"the file is compressed with {kind}: MCAP is read as it was recorded",
                    hint="decompress it first, with `gunzip` or `zstd -d`",
                )
        self._check_mark(head, "at its start: this is no MCAP file")

    def closing(self) -> None:
        """Read the mark at the end."""
        self._check_mark(self._read(len(_MAGIC), short=True), "at its end")

    def _check_mark(self, found: bytes, place: str) -> None:
        if found != _MAGIC:
            raise self._cut(f"the file lacks its mark {place}")

    def at_end(self) -> bool:
        """Tell whether every byte is read."""
        return self.position == self._size

    def _pass(self, length: int) -> None:
        while length:
            length -= len(self._read(min(length, _PIECE)))

    def _read(self, length: int, *, short: bool = False) -> bytes:
        data = self._file.read(length)
        self.position += len(data)
        self.crc = zlib.crc32(data, self.crc)
        if len(data) < length and not short:
            raise self._cut(f"the file ends at byte {self.position}, before its end")
        return data

    def _cut(self, what: str) -> TruncatedError:
        return TruncatedError(what, hint=HINT)
