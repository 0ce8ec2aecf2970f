"""The records of an MCAP file, one after the other, and what it repeats of them at its end."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Schema, Statistics

from tdfscal.errors import DataError
from tdfscal.logs.mcap.chunk import exact

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
_FOOTER_BYTES: Final = HEAD.size + 20 + 8  # with the mark at the end
_LARGEST: Final = 64 << 20
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
        if head != _MAGIC:
            raise self._cut("the file lacks its mark at its start: this is no MCAP file")

    def closing(self) -> None:
        """Read the mark at the end."""
        if self._read(len(_MAGIC), short=True) != _MAGIC:
            raise self._cut("the file lacks its mark at its end")

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


class Summary(NamedTuple):
    """Schemas and channels by id. complete : the file has no others. sound : no checksum denies it.

    A name in a summary whose checksum does not match may be another one.
    """

    schemas: Mapping[int, Schema]
    channels: Mapping[int, Channel]
    complete: bool
    sound: bool


def read_summary(path: Path) -> Summary:
    """Return what a file says at its end, before the rest is read; nothing where that is damaged.

    So a wrong mapping is named at once, and definitions that are damaged in their place are known.
    What is damaged is left to the reading of the file, which says where.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    stated = 0
    try:
        with path.open("rb") as file:
            end = path.stat().st_size - _FOOTER_BYTES
            stream = RecordStream(file, path)
            stream.seek(max(end, 0))
            _, content = stream.record(frozenset({Opcode.FOOTER}))
            footer = Footer.read(exact(content))
            if not footer.summary_start:
                return Summary({}, {}, complete=False, sound=True)
            if end - footer.summary_start > _LARGEST:
                raise ValueError("the footer points to the wrong place")
            stream.seek(footer.summary_start)
            while (record := stream.record(IN_SUMMARY))[0] != Opcode.FOOTER:
                opcode, content = record
                if opcode == Opcode.SCHEMA:
                    schema = Schema.read(exact(content))
                    schemas[schema.id] = schema
                elif opcode == Opcode.CHANNEL:
                    channel = Channel.read(exact(content))
                    channels[channel.id] = channel
                elif opcode == Opcode.STATISTICS:
                    stated = Statistics.read(exact(content)).channel_count
    except (OSError, ValueError, struct.error, McapError, TruncatedError):
        return Summary({}, {}, complete=False, sound=False)
    sound = footer.summary_crc in (0, summary_crc(stream.crc_before, record[1]))
    return Summary(schemas, channels, complete=len(channels) == stated > 0, sound=sound)
